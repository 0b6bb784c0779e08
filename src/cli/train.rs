//! `armpose train`: from a data set to a model.

use super::ruler::Ruler;
use super::{progress_bar, say, tell_notes, use_threads};
use anyhow::{Result, ensure};
use armpose::camera::Photographer;
use armpose::dataset::{DataSet, Studio};
use armpose::experiment::progress::duration;
use armpose::forest::objective::{OBJECTIVES, ObjectiveKind};
use armpose::model::Model;
use armpose::model::training::{ModelSpec, train};
use armpose::random::seed;
use armpose::scene::Rig;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Train a model that estimates the joints of an arm
///
/// Example: armpose train --data images --robot my_robot.toml -o my_model
///
/// DATA is what `armpose dataset render` made. Two forests are trained: one finds the pixels of the
/// arm, the other estimates its joints from them. MODEL is a folder with both and with model.json,
/// which tells what they are for. The parameters are the paper's; 500 images of 640 x 480 take a few
/// minutes on two cores. The same data set gives the same model.
///
/// What the model is worth is told at the end: its errors on 60 new images, drawn as those of the set
/// were, beside those of a constant pose.
///
/// Then: armpose evaluate --model my_model --data other_images
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// The data set to train on
    #[arg(long, value_name = "FOLDER")]
    data: PathBuf,
    /// The robot.toml that the data set was rendered from
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// The model, a new folder
    #[arg(short, long, value_name = "FOLDER")]
    out: PathBuf,
    /// What splits make small: mse, or one of the paper's and our objectives of displacement
    #[arg(long, default_value = "mse", value_parser = objective())]
    objective: &'static ObjectiveKind,
    /// Trees of each forest
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u16).range(2..=1000))]
    trees: u16,
    /// Pixels drawn from each image [default: 3000, or fewer so that they are 6 million in all]
    #[arg(long, value_parser = clap::value_parser!(u32).range(3..=100_000))]
    pixels: Option<u32>,
    /// Estimate images as they are; the model then cannot tell whether the arm is visible
    #[arg(long)]
    no_segmentation: bool,
    /// Threads to use; the model does not depend on it [default: one for each core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// As in the paper: 480,000 samples come from 160 images.
const PIXELS: usize = 3000;
/// With 500 features these take about 7 GB.
const MOST_SAMPLES: usize = 6_000_000;

fn objective() -> impl TypedValueParser<Value = &'static ObjectiveKind> {
    PossibleValuesParser::new(OBJECTIVES.iter().map(|kind| kind.id)).map(|id| {
        // Only what is in the list is possible.
        ObjectiveKind::named(&id).unwrap_or(&OBJECTIVES[0])
    })
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    use_threads(arguments.threads.map(usize::from))?;
    let begin = Instant::now();
    let out = &arguments.out;
    ensure!(
        !out.exists(),
        "{} exists already; choose another name or remove it",
        out.display()
    );
    let set = DataSet::open(&arguments.data)?;
    let rig = Rig::read(&arguments.robot)?;
    tell_notes(&rig);
    let robot = arguments.robot.canonicalize()?;

    let mut spec = ModelSpec::of_paper(set.camera().intrinsics.width);
    spec.objective = arguments.objective;
    spec.learn_absence = set.images_with_robot().len() < set.len();
    if arguments.no_segmentation {
        spec.segmentation = None;
    }
    let fewer = PIXELS.min(MOST_SAMPLES / set.len()).max(3);
    let pixels = arguments.pixels.map_or(fewer, |pixels| pixels as usize);
    for training in std::iter::once(&mut spec.pose).chain(&mut spec.segmentation) {
        training.background = pixels * training.background / PIXELS;
        training.foreground = pixels - training.background;
        training.forest.trees = arguments.trees.into();
    }

    let shown = set.images_with_robot().len();
    let bar = progress_bar(spec.steps(set.len(), shown), "steps");
    let model = train(&set, (&rig, &robot), &spec, &|n| bar.inc(n));
    bar.finish_and_clear();
    let model = model?;
    model.save(out)?;
    say(&format!(
        "{}: a model of the {} joints of arm \"{}\", trained on {} images in {}\n{}",
        out.display(),
        set.target_joints().len(),
        set.record().specification.target,
        set.len(),
        duration(begin.elapsed().as_secs_f64()),
        trial(&model, &set, &rig)?
    ))?;
    Ok(ExitCode::SUCCESS)
}

/// So many new images tell what a model is worth.
const TRIAL: usize = 60;
/// A model whose DISP is a larger share than this of that of a constant pose has learnt next to nothing.
const HARDLY_BETTER: f64 = 0.85;

/// What a model makes of new images, drawn as those of its set were.
fn trial(model: &Model, set: &DataSet, rig: &Rig) -> Result<String> {
    let of_set = set.record();
    let mut spec = of_set.specification.clone();
    spec.name = of_set.name.clone();
    let studio = Studio::new(&spec, rig.clone(), of_set.camera)?;
    let seed = seed(of_set.seed, "trial of a model", &[]);
    let ruler = Ruler::new(model.record(), rig)?;
    let target = &rig.arms[set.target()].joints;
    let mut photographer = Photographer::new(&of_set.camera);
    let (mut shown, mut found, mut rooms, mut false_arms) = (0, 0, 0, 0);
    let (mut errors, mut constant) = (Vec::new(), Vec::new());
    for image in 0..TRIAL {
        let shot = studio.shoot(image, &mut photographer, seed)?;
        let pose = model.estimate(&shot.photo.depth, 1).pose;
        let Some(configuration) = shot.configuration else {
            rooms += 1;
            false_arms += usize::from(pose.is_some());
            continue;
        };
        shown += 1;
        if let Some(pose) = pose {
            found += 1;
            let truth: Vec<f64> = target.iter().map(|&dof| configuration[dof]).collect();
            errors.push(ruler.measure(&truth, &pose.values));
            constant.push(ruler.measure(&truth, &model.record().mean_pose));
        }
    }
    let mut text =
        format!("on {TRIAL} new images drawn the same way: the arm is found in {found} of {shown}");
    if rooms > 0 {
        text.push_str(&format!(
            ", and in {false_arms} of {rooms} without the robot"
        ));
    }
    if errors.is_empty() {
        text.push_str(
            "\nwarning: nothing can be estimated; is the arm seen at all (contact-sheet.png)?\n",
        );
        return Ok(text);
    }
    let mean_of = |rows: &[Vec<f64>], from_end: usize| {
        let values = rows.iter().map(|row| row[row.len() - from_end]);
        values.sum::<f64>() / rows.len() as f64
    };
    let [joints, tip, disp] = [3, 2, 1].map(|at| (mean_of(&errors, at), mean_of(&constant, at)));
    if !joints.0.is_nan() {
        let (mean, floor) = joints;
        text.push_str(&format!(
            "; joints err by {mean:.1} deg (a constant pose: {floor:.1})"
        ));
    }
    text.push_str(&format!(
        "; the tip by {:.0} mm ({:.0}), DISP {:.0} mm ({:.0})\n",
        tip.0, tip.1, disp.0, disp.1
    ));
    if disp.0 > HARDLY_BETTER * disp.1 {
        text.push_str(
            "warning: this is hardly better than answering with the same pose always; narrower \
             [poses.ranges], more images, or a camera that sees more of the arm help\n",
        );
    }
    Ok(text)
}
