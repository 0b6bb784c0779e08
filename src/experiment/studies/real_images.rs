//! Models that have seen synthetic images only, on real ones (section IV-F, Fig. 12), with numbers.

use crate::camera::{Camera, Photographer};
use crate::dataset::RealFrames;
use crate::experiment::figure::{Axis, DepthPanel, Figure, Mark, Panel, PicturePanel, Plot, Shape};
use crate::experiment::protocol::Ruler;
use crate::experiment::shared;
use crate::experiment::statistics::{mean, standard_deviation};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::model::{
    Known, MODEL, ModelEstimated, ModelEstimatesTask, ModelTask,
};
use crate::forest::objective::ObjectiveKind;
use crate::model::Model;
use crate::model::training::ModelSpec;
use crate::scene::{ESTIMATED, KNOWN, Rig, cloud, draw_arm};
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The synthetic images: a file of `data/sets/`, without extension.
    pub set: String,
    /// The real ones: a file that [`RealFrames`] reads, in the folder [`shared`].
    pub real: PathBuf,
    pub objective: &'static ObjectiveKind,
    /// How many images models are trained on; each number a model. Images are segmented.
    pub images: Vec<usize>,
    /// One more model is trained on so many images as they are.
    pub whole: usize,
    /// Each forest is trained on at most so many pixels; fewer an image when there are more images.
    pub samples: usize,
    /// Further synthetic images, to tell how much of an error is due to real ones.
    pub held_out: usize,
    /// Joints that a depth image hardly tells. Errors are given with and without them.
    pub apart: Vec<String>,
}

/// No claim can be tested: another robot than the paper's.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {}

/// A model with its estimates.
struct Tried {
    id: String,
    title: String,
    images: usize,
    model: Arc<ModelTask>,
    real: Arc<ModelEstimatesTask>,
    held_out: Arc<ModelEstimatesTask>,
}

struct RealImages {
    specification: Specification<Parameters, Test>,
    real: PathBuf,
    /// Segmented by number of images, and then the one that sees images as they are.
    tried: Vec<Tried>,
    held_out: Arc<DataSetTask>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Specification {
        root,
        seed,
        parameters,
        ..
    } = &specification;
    if parameters.images.is_empty() || parameters.held_out == 0 {
        bail!("`images` must name at least one number, and `held_out` must not be 0");
    }
    let set = |images: usize| DataSetTask::new(root, &parameters.set, images, *seed);
    let real = shared(root).join(&parameters.real);
    let mut held_out = set(parameters.held_out)?;
    // Sets of different name share no image.
    held_out.spec.name.push_str("_held_out");
    let held_out = Arc::new(held_out);
    let sizes = parameters.images.iter().map(|&images| (images, true));
    let mut tried = Vec::new();
    for (images, is_segmented) in sizes.chain([(parameters.whole, false)]) {
        let set = Arc::new(set(images)?);
        let width = Camera::read(&set.spec.camera_path())?.intrinsics.width;
        let mut spec = ModelSpec::of_paper(width);
        spec.objective = parameters.objective;
        spec.segmentation = spec.segmentation.filter(|_| is_segmented);
        for training in spec.segmentation.iter_mut().chain([&mut spec.pose]) {
            let pixels = training.samples_per_image();
            let fewer = pixels.min(parameters.samples / images).max(2);
            training.foreground = (training.foreground * fewer / pixels).max(1);
            training.background = fewer - training.foreground;
        }
        let model = Arc::new(ModelTask { set, spec });
        let estimates = |images: Known| {
            let model = model.clone();
            Arc::new(ModelEstimatesTask { model, images })
        };
        let sees = if is_segmented {
            "segmented"
        } else {
            "as they are"
        };
        tried.push(Tried {
            id: format!(
                "{}/{}",
                if is_segmented { "segmented" } else { "whole" },
                images
            ),
            title: format!("{images} images, {sees}"),
            images,
            real: estimates(Known::Real(real.clone())),
            held_out: estimates(Known::Set(held_out.clone())),
            model: model.clone(),
        });
    }
    Ok(Box::new(RealImages {
        specification,
        real,
        tried,
        held_out,
    }))
}

/// The errors of a method in one image.
struct Measured {
    /// Whether pixels are of a real image.
    is_real: bool,
    image: usize,
    /// Whether the model says that it sees the arm; otherwise the estimate is the mean pose.
    is_seen: bool,
    joints_deg: Vec<f64>,
    all_deg: f64,
    apart_deg: f64,
    disp_m: f64,
    tip_m: f64,
}

/// What a method says of all images.
struct Method {
    id: String,
    title: String,
    /// Training images.
    images: usize,
    measured: Vec<Measured>,
}

impl Method {
    fn values(&self, is_real: bool, value: impl Fn(&Measured) -> f64) -> Vec<f64> {
        let of_kind = self.measured.iter().filter(|m| m.is_real == is_real);
        of_kind.map(value).collect()
    }
}

impl Study for RealImages {
    fn missing(&self) -> Option<String> {
        let no = |path: PathBuf| format!("there is no {}", path.display());
        match self.held_out.missing() {
            Ok(None) => (!self.real.is_file()).then(|| no(self.real.clone())),
            Ok(Some(urdf)) => Some(no(urdf)),
            Err(error) => Some(error.to_string()),
        }
    }

    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let mut tasks: Vec<Arc<dyn Task>> = Vec::new();
        for tried in &self.tried {
            tasks.push(tried.model.clone());
            tasks.push(tried.real.clone());
            tasks.push(tried.held_out.clone());
        }
        Ok(tasks)
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let (rig, arm) = self.held_out.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let mut methods = Vec::new();
        for tried in &self.tried {
            let model = Model::load(&done(&*tried.model)?.join(MODEL))?;
            let constant = &model.record().mean_pose;
            let mut measured = [Vec::new(), Vec::new()];
            for (is_real, task) in [(true, &tried.real), (false, &tried.held_out)] {
                for (image, one) in ModelEstimatesTask::read(&done(&**task)?)?
                    .iter()
                    .enumerate()
                {
                    let pose = one.estimate.pose.as_ref().map(|pose| &pose.values);
                    let [of_model, of_constant] = &mut measured;
                    let place = (is_real, image);
                    of_model.push(self.measure(&ruler, place, &one.truth, pose, constant));
                    of_constant.push(self.measure(&ruler, place, &one.truth, None, constant));
                }
            }
            let [of_model, of_constant] = measured;
            if methods.is_empty() {
                methods.push(Method {
                    id: "constant".to_owned(),
                    title: "constant pose".to_owned(),
                    images: tried.images,
                    measured: of_constant,
                });
            }
            methods.push(Method {
                id: tried.id.clone(),
                title: tried.title.clone(),
                images: tried.images,
                measured: of_model,
            });
        }
        let summary = summary(&methods);
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: data(ruler.joints(), &methods),
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![
                (
                    self.specification.id.clone(),
                    self.pictures((&rig, arm), done)?,
                ),
                (
                    format!("{}_errors", self.specification.id),
                    self.errors(&methods),
                ),
            ],
            claims: claims.map(|claim| claim.without_test()).collect(),
        })
    }
}

impl RealImages {
    fn measure(
        &self,
        ruler: &Ruler,
        (is_real, image): (bool, usize),
        truth: &[f64],
        pose: Option<&Vec<f64>>,
        constant: &Vec<f64>,
    ) -> Measured {
        let error = ruler.measure(truth, pose.unwrap_or(constant));
        let apart = &self.specification.parameters.apart;
        let names = ruler.joints().iter().zip(&error.joints_deg);
        let told: Vec<f64> = names
            .filter(|(name, _)| !apart.iter().any(|apart| apart == *name))
            .map(|(_, &error)| error)
            .collect();
        Measured {
            is_real,
            image,
            is_seen: pose.is_some(),
            all_deg: error.all_deg,
            apart_deg: mean(&told),
            disp_m: error.disp_m,
            tip_m: error.tip_m,
            joints_deg: error.joints_deg,
        }
    }

    /// As in Fig. 12: the depth images above; below, the point cloud in orange, the arm by the encoders
    /// in grey and by the model of the most images in blue.
    fn pictures(&self, (rig, arm): (&Rig, usize), done: Done<'_>) -> Result<Figure> {
        let segmented = self
            .tried
            .iter()
            .filter(|tried| tried.model.spec.segmentation.is_some());
        let best = segmented
            .max_by_key(|tried| tried.images)
            .context("no model")?;
        let model = Model::load(&done(&*best.model)?.join(MODEL))?;
        let camera = Camera::read(&self.held_out.spec.camera_path())?;
        let real = RealFrames::read(&self.real)?;
        let view = model.view_of(&real.camera)?;
        let mut photographer = Photographer::new(&camera);
        let (mut above, mut below) = (Vec::new(), Vec::new());
        let estimates = ModelEstimatesTask::read(&done(&*best.real)?)?;
        for (frame, ModelEstimated { truth, estimate }) in estimates.iter().enumerate() {
            let depth = view.apply(&real.depth(frame)?);
            let far = camera.range.far_m * 1000.0;
            let mut picture = cloud(&depth, &camera.range);
            let mut draw = |pose: &[f64], colour| {
                let mut configuration = vec![0.0; rig.robot.dofs()];
                for (&dof, &value) in rig.arms[arm].joints.iter().zip(pose) {
                    configuration[dof] = value;
                }
                rig.robot.apply_mimics(&mut configuration);
                let (arm, camera) = ((rig, arm), model.camera_from_root());
                draw_arm(
                    &mut picture,
                    &mut photographer,
                    arm,
                    &configuration,
                    &camera,
                    colour,
                );
            };
            draw(truth, KNOWN);
            if let Some(pose) = &estimate.pose {
                draw(&pose.values, ESTIMATED);
            }
            above.push(Panel::Depth(DepthPanel {
                title: format!("frame {frame}"),
                image: depth,
                range_mm: (500, far as u16),
            }));
            let sees = match &estimate.pose {
                Some(_) => "estimate",
                None => "no arm seen",
            };
            below.push(Panel::Picture(PicturePanel {
                title: sees.to_owned(),
                image: picture,
            }));
        }
        let columns = above.len().max(1);
        above.append(&mut below);
        Ok(Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Above: real depth images. Below: orange the point cloud, grey the arm by its encoders, blue \
                 the estimate of a model of {} synthetic images.",
                best.images
            ),
            panels: above,
            columns,
            size: (420 * columns as u32, 590),
        })
    }

    fn errors(&self, methods: &[Method]) -> Figure {
        let segmented = || methods.iter().filter(|m| m.id.starts_with("segmented"));
        let line = |is_real: bool| {
            let points = segmented().map(|m| {
                (
                    m.images as f64,
                    mean(&m.values(is_real, |error| error.apart_deg)),
                )
            });
            points.collect::<Vec<_>>()
        };
        let bars = segmented().map(|m| {
            let errors = m.values(false, |error| error.apart_deg);
            let half = standard_deviation(&errors) / (errors.len() as f64).sqrt();
            (m.images as f64, mean(&errors) - half, mean(&errors) + half)
        });
        let frames = segmented().flat_map(|m| {
            let errors = m.values(true, |error| error.apart_deg).into_iter();
            errors.map(|error| (m.images as f64, error))
        });
        let mut marks = vec![
            Mark::new("", 0, Shape::Errors(bars.collect())),
            Mark::new("held-out synthetic images", 0, Shape::Line(line(false))),
            Mark::new("each real image", 4, Shape::Scatter(frames.collect())),
            Mark::new("real images", 1, Shape::Line(line(true))),
        ];
        for method in methods {
            let of = |is_real| mean(&method.values(is_real, |error| error.apart_deg));
            if method.id == "constant" {
                marks.push(Mark::new("constant pose, real", 7, Shape::Level(of(true))));
                marks.push(Mark::new(
                    "constant pose, synthetic",
                    0,
                    Shape::Level(of(false)),
                ));
            } else if method.id.starts_with("whole") {
                let points = |is_real| Shape::Scatter(vec![(method.images as f64, of(is_real))]);
                marks.push(Mark::new("as they are, synthetic", 5, points(false)));
                marks.push(Mark::new("as they are, real", 3, points(true)));
            }
        }
        let apart = self.specification.parameters.apart.join(", ");
        Figure {
            title: "Synthetic images to learn from, real ones to estimate".to_owned(),
            caption: "Means over images; whiskers: one standard error over the held-out images."
                .to_owned(),
            panels: vec![Panel::Plot(Plot {
                title: String::new(),
                x: Axis::new("synthetic training images").log(),
                y: Axis::new(&format!("mean absolute joint error without {apart} (deg)"))
                    .including(0.0, 0.0),
                marks,
            })],
            columns: 1,
            size: (1100, 800),
        }
    }
}

fn source(is_real: bool) -> Cell {
    if is_real { "real" } else { "synthetic" }.into()
}

fn data(joints: &[&str], methods: &[Method]) -> Table {
    let header = ["method", "images", "source", "image", "seen"].map(str::to_owned);
    let errors = ["error_deg", "error_told_deg", "disp_m", "tip_m"].map(str::to_owned);
    let of_joints = joints.iter().map(|joint| format!("{joint}_deg"));
    let mut table = Table::new(header.into_iter().chain(errors).chain(of_joints));
    for method in methods {
        for one in &method.measured {
            let place: [Cell; 5] = [
                method.id.as_str().into(),
                method.images.into(),
                source(one.is_real),
                one.image.into(),
                usize::from(one.is_seen).into(),
            ];
            let errors = [one.all_deg, one.apart_deg, one.disp_m, one.tip_m];
            let errors = errors.into_iter().chain(one.joints_deg.iter().copied());
            table.push(place.into_iter().chain(errors.map(Cell::from)));
        }
    }
    table
}

fn summary(methods: &[Method]) -> Table {
    let mut table = Table::new([
        "method",
        "title",
        "source",
        "images",
        "seen",
        "error_deg",
        "error_told_deg",
        "error_told_sd_deg",
        "disp_m",
        "tip_m",
    ]);
    for is_real in [true, false] {
        for method in methods {
            let of = |value: fn(&Measured) -> f64| method.values(is_real, value);
            let told = of(|m| m.apart_deg);
            table.push([
                method.id.as_str().into(),
                method.title.as_str().into(),
                source(is_real),
                told.len().into(),
                (of(|m| f64::from(u8::from(m.is_seen))).iter().sum::<f64>() as usize).into(),
                mean(&of(|m| m.all_deg)).into(),
                mean(&told).into(),
                standard_deviation(&told).into(),
                mean(&of(|m| m.disp_m)).into(),
                mean(&of(|m| m.tip_m)).into(),
            ]);
        }
    }
    table
}
