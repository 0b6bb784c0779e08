//! `armpose evaluate`: a model against images whose joints are known.

use super::overlay::{Overlays, rig_of};
use super::ruler::Ruler;
use super::{progress_bar, say, use_threads};
use anyhow::{Context, Result, ensure};
use armpose::dataset::DataSet;
use armpose::experiment::statistics::{mean, quantile, spearman};
use armpose::experiment::table::{Cell, Table};
use armpose::model::{Estimate, JointRecord, Model, ModelRecord};
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure the errors of a model on a data set, whose joints are known
///
/// Example: armpose evaluate --model my_model --data other_images --csv errors.csv
///
/// Render the images from the same files as those of the training, with another --seed. For each
/// joint: the mean and the median of the absolute error, in degrees (mm for joints that slide), beside
/// that of always answering with the mean pose of the training images, which any model must beat.
/// Below: the mean over the joints that turn, the distance between the true and the estimated tip, and
/// DISP, the distance of the arm's farthest point from where it should be. All over the images that show
/// the robot and in which the model sees the arm.
///
/// Whether it sees the arm where it should, and sees none where there is no robot, is told first: a set
/// holds images without the robot by its without_robot. Arms found in these are false.
///
/// Rank correlations over the images tell what the numbers that come with an estimate are worth: that of
/// a joint's spread with its error (1: the larger the spread, the larger the error; 0: it tells nothing),
/// and that of the confidence with DISP (-1: the surer, the nearer).
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// The model, as `armpose train` wrote it
    #[arg(long, value_name = "FOLDER")]
    model: PathBuf,
    /// The data set to estimate
    #[arg(long, value_name = "FOLDER")]
    data: PathBuf,
    /// Write the errors of each image
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draw the true arm in grey and the estimated one in blue over each image, into this folder
    #[arg(long, value_name = "FOLDER")]
    overlay: Option<PathBuf>,
    /// The robot.toml, if it is not where it was when the model was trained
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Evaluate even on the images that the model was trained on, which says little about others
    #[arg(long)]
    seen_images: bool,
    /// Threads to use; the errors do not depend on it [default: one for each core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    use_threads(arguments.threads.map(usize::from))?;
    let model = Model::load(&arguments.model)?;
    let record = model.record();
    let set = DataSet::open(&arguments.data)?;
    let of_set = set.record();
    let trained_on = &record.trained_on;
    ensure!(
        arguments.seen_images || (&trained_on.set, trained_on.seed) != (&of_set.name, of_set.seed),
        "the model was trained on images of set {} with seed {}, which are these; render others with \
         another --seed, or insist with --seen-images",
        of_set.name,
        of_set.seed
    );
    let joints = record.joints.iter().map(|joint| &joint.name);
    ensure!(
        joints.eq(set.target_joints()),
        "the target of set {} has the joints {}, not those of the model",
        of_set.name,
        set.target_joints().join(", ")
    );
    let rig = rig_of(record, arguments.robot.as_deref())?;
    let ruler = Ruler::new(record, &rig)?;
    let resampling = model.view_of(&set.camera().intrinsics)?;
    let mut overlays = match &arguments.overlay {
        Some(folder) => Some(Overlays::new(folder, &model, &rig)?),
        None => None,
    };

    let bar = progress_bar(set.len() as u64, "images");
    let mut looked = Vec::new();
    for image in 0..set.len() {
        let depth = resampling.apply(&set.frame(image)?.depth);
        let estimate = model.estimate(&depth, 1);
        if let Some(overlays) = &mut overlays {
            overlays.draw_beside_truth(&set, image, &depth, estimate.pose.as_ref())?;
        }
        looked.push(Looked {
            shown_pixels: of_set.images[image].arms[set.target()],
            truth: (!of_set.images[image].without_robot).then(|| set.pose(image).to_vec()),
            estimate,
        });
        bar.inc(1);
    }
    bar.finish_and_clear();

    if let Some(path) = &arguments.csv {
        std::fs::write(path, per_image(&ruler, &looked).to_csv())
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    say(&format!("{}\n", visibility(record, &looked).to_text()))?;
    say(&summary(&ruler, &looked))?;
    Ok(ExitCode::SUCCESS)
}

/// An image and what the model says of it.
struct Looked {
    /// Valid pixels that show the arm.
    shown_pixels: usize,
    /// Absent where there is no robot.
    truth: Option<Vec<f64>>,
    estimate: Estimate,
}

/// A row for each image.
fn per_image(ruler: &Ruler, looked: &[Looked]) -> Table {
    let mut columns: Vec<String> = [
        "image",
        "robot",
        "shown_px",
        "presence",
        "arm_px",
        "arm_found",
        "confidence",
    ]
    .map(str::to_owned)
    .to_vec();
    let joints = ruler.record.joints.iter().map(JointRecord::column);
    columns.extend(joints.flat_map(|joint| [format!("spread_{joint}"), joint]));
    columns.extend(ruler.columns().iter().map(|name| format!("error_{name}")));
    let mut table = Table::new(columns);
    let missing = || Cell::from("");
    for (image, looked) in looked.iter().enumerate() {
        let Estimate {
            presence,
            sure_pixels,
            pose,
        } = &looked.estimate;
        let mut row: Vec<Cell> = vec![
            image.into(),
            usize::from(looked.truth.is_some()).into(),
            looked.shown_pixels.into(),
            presence.map_or_else(missing, Cell::from),
            sure_pixels.map_or_else(missing, Cell::from),
            usize::from(pose.is_some()).into(),
        ];
        if let Some(pose) = pose {
            row.push(pose.confidence.into());
            let joints = pose.spread.iter().zip(&pose.values);
            row.extend(joints.flat_map(|(&spread, &value)| [spread.into(), value.into()]));
            if let Some(truth) = &looked.truth {
                let errors = ruler.measure(truth, &pose.values);
                row.extend(errors.into_iter().map(Cell::from));
            }
        }
        row.resize_with(table.columns.len(), missing);
        table.push(row);
    }
    table
}

/// How many images show the arm, and in how many it is found. Rows without any image are left out.
fn visibility(record: &ModelRecord, looked: &[Looked]) -> Table {
    let mut table = Table::new(["images", "arm_found", "arm_not_found"]);
    let least = record.least_arm_pixels;
    type Fits = fn(&Looked, usize) -> bool;
    let rows: [(String, Fits); 3] = [
        (
            format!("the arm shows {least} pixels or more"),
            |one, least| one.truth.is_some() && one.shown_pixels >= least,
        ),
        ("it shows fewer".to_owned(), |one, least| {
            one.truth.is_some() && one.shown_pixels < least
        }),
        ("there is no robot".to_owned(), |one, _| one.truth.is_none()),
    ];
    for (name, fits) in rows {
        let of_kind: Vec<&Looked> = looked.iter().filter(|one| fits(one, least)).collect();
        let found = of_kind
            .iter()
            .filter(|one| one.estimate.pose.is_some())
            .count();
        if !of_kind.is_empty() {
            table.push([name.into(), found.into(), (of_kind.len() - found).into()]);
        }
    }
    table
}

fn column(rows: &[Vec<f64>], at: usize) -> Vec<f64> {
    rows.iter().map(|row| row[at]).collect()
}

fn summary(ruler: &Ruler, looked: &[Looked]) -> String {
    let (mut errors, mut constant) = (Vec::new(), Vec::new());
    let (mut spreads, mut confidences) = (Vec::new(), Vec::new());
    for one in looked {
        if let (Some(pose), Some(truth)) = (&one.estimate.pose, &one.truth) {
            errors.push(ruler.measure(truth, &pose.values));
            constant.push(ruler.measure(truth, &ruler.record.mean_pose));
            spreads.push(pose.spread.clone());
            confidences.push(pose.confidence);
        }
    }
    if errors.is_empty() {
        return "the arm is found in no image of the robot\n".to_owned();
    }
    let mut table = Table::new([
        "error",
        "mean",
        "median",
        "constant_pose_mean",
        "spread_correlation",
    ]);
    for (at, name) in ruler.columns().into_iter().enumerate() {
        let unsorted = column(&errors, at);
        let mut sorted = unsorted.clone();
        sorted.sort_by(f64::total_cmp);
        let spread: Cell = match at < ruler.record.joints.len() {
            true => spearman(&column(&spreads, at), &unsorted).into(),
            false => "".into(),
        };
        table.push([
            name.into(),
            mean(&sorted).into(),
            quantile(&sorted, 0.5).into(),
            mean(&column(&constant, at)).into(),
            spread,
        ]);
    }
    let disp: Vec<f64> = errors
        .iter()
        .filter_map(|row| row.last())
        .copied()
        .collect();
    format!(
        "{}\nconfidence and DISP of an image: rank correlation {:.2}\n",
        table.to_text(),
        spearman(&confidences, &disp)
    )
}
