//! The part-classification baseline beside the regression of joint angles (section IV-E): [`angles`] for
//! Fig. 11a, [`parts`] for Fig. 11b, [`runtime`] for the effort at test time.

pub mod angles;
pub mod parts;
pub mod runtime;
mod verdicts;

use super::cross_validation::Parameters as Comparison;
use super::segmentation::sight;
use super::sets::SetSize;
use crate::estimator::part_baseline::BaselineSpec;
use crate::experiment::protocol::{CrossValidation, Protocol, step_of};
use crate::experiment::study::Profile;
use crate::experiment::study_file::parameters_of;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::part_estimates::{PartEstimatesTask, Voting};
use crate::experiment::tasks::part_forest::PartForestTask;
use crate::experiment::tasks::pose_forest::PoseForestTask;
use crate::experiment::tasks::sight::{SegmentationKind, Sight};
use crate::forest::objective::ObjectiveKind;
use crate::training::Training;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose images and folds are taken.
    pub study: String,
    /// Its best method.
    pub objective: &'static ObjectiveKind,
    pub segmentation: SegmentationKind,
    /// Files of `data/baselines/`, without extension; trained on the study's folds.
    pub baselines: Vec<String>,
    /// One of them once more, trained on other and more images.
    pub large: Large,
    /// An image hardly shows the arm when fewer of its valid pixels do.
    pub little_px: usize,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Large {
    pub baseline: String,
    pub set: SetSize,
    /// Pixels drawn from each image.
    pub foreground: usize,
    pub background: usize,
}

/// Of a study that looks at what another of this kind compares.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SameAs {
    pub study: String,
}

/// All that is compared.
struct Compared {
    validation: CrossValidation,
    protocol: Protocol,
    ours: Vec<Arc<EstimatesTask>>,
    /// The step of the relative threshold.
    step: usize,
    /// With the literature's numbers, with others, ..., and the one trained on more images last.
    baselines: Vec<Baseline>,
    oracle: Baseline,
}

/// A baseline's estimates of all images.
struct Baseline {
    id: String,
    title: String,
    tasks: Vec<Arc<PartEstimatesTask>>,
}

impl Compared {
    fn new(place: (&Path, Profile, u64), parameters: &Parameters) -> Result<Compared> {
        let (root, profile, seed) = place;
        let of: Comparison = parameters_of(root, profile, &parameters.study)?;
        let validation = CrossValidation::new(root, seed, of.protocol.clone())?;
        let kind = parameters.segmentation;
        let sight = sight(kind, &of.segmentation_study, place, &validation.set)?;
        let read = |name: &String| -> Result<BaselineSpec> {
            let mut baseline =
                BaselineSpec::read(&root.join(format!("data/baselines/{name}.toml")))?;
            // Smaller profiles have fewer features than there are candidates.
            let candidates = &mut baseline.forest.features_per_node;
            *candidates = (*candidates).min(of.protocol.training.features.count);
            Ok(baseline)
        };
        let mut baselines = Vec::new();
        for name in &parameters.baselines {
            baselines.push(Baseline {
                id: format!("part-baseline-{name}"),
                title: format!("parts, {name}"),
                tasks: validation.part_estimates(&read(name)?, Voting::Forest)?,
            });
        }
        let Large {
            baseline,
            set: SetSize { name, images },
            foreground,
            background,
        } = &parameters.large;
        if *name == of.protocol.set {
            bail!("large.set = \"{name}\": the test images are of this set; choose another");
        }
        let set = Arc::new(DataSetTask::new(root, name, *images, seed)?);
        let samples = PoseForestTask {
            set,
            images: (0..*images).collect(),
            objective: parameters.objective,
            training: Training {
                foreground: *foreground,
                background: *background,
                ..of.protocol.training.clone()
            },
            sight: Sight::WHOLE,
            fold: 0,
        };
        let baseline = read(baseline)?;
        let forest = Arc::new(PartForestTask {
            samples: Arc::new(samples),
            baseline: baseline.clone(),
        });
        let all = (0..of.protocol.images).collect();
        let large = PartEstimatesTask::new(
            forest,
            validation.set.clone(),
            all,
            Voting::Forest,
            of.protocol.stride,
        )?;
        baselines.push(Baseline {
            id: "part-baseline-large".to_owned(),
            title: format!("parts, {images} images"),
            tasks: vec![Arc::new(large)],
        });
        Ok(Compared {
            ours: validation.estimates_seen(parameters.objective, &sight)?,
            step: step_of(of.t_r)?,
            baselines,
            oracle: Baseline {
                id: "part-baseline-oracle".to_owned(),
                title: "parts, true votes".to_owned(),
                tasks: validation.part_estimates(&baseline, Voting::Oracle)?,
            },
            validation,
            protocol: of.protocol,
        })
    }
}
