//! `armpose train`: from a data set to a model.

use super::{progress_bar, say, use_threads};
use anyhow::{Result, ensure};
use armpose::dataset::DataSet;
use armpose::experiment::progress::duration;
use armpose::forest::objective::{OBJECTIVES, ObjectiveKind};
use armpose::model::training::{ModelSpec, train};
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
    let robot = arguments.robot.canonicalize()?;

    let mut spec = ModelSpec::of_paper(set.camera().intrinsics.width);
    spec.objective = arguments.objective;
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

    let bar = progress_bar(spec.steps(set.len()), "steps");
    let model = train(&set, (&rig, &robot), &spec, &|n| bar.inc(n));
    bar.finish_and_clear();
    model?.save(out)?;
    say(&format!(
        "{}: a model of the {} joints of arm \"{}\", trained on {} images in {}\n",
        out.display(),
        set.target_joints().len(),
        set.record().specification.target,
        set.len(),
        duration(begin.elapsed().as_secs_f64())
    ))?;
    Ok(ExitCode::SUCCESS)
}
