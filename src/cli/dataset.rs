//! `armpose dataset`: images of a robot to train on.

use super::{progress_bar, say, tell_notes, use_threads};
use anyhow::Result;
use armpose::dataset::{SetSpec, SheetStyle, contact_sheet, generate};
use armpose::experiment::progress::duration;
use armpose::scene::Rig;
use clap::Subcommand;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Make images to train on
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(Render),
}

/// Draw a robot in random poses and photograph it with a simulated depth camera
///
/// Example: armpose dataset render my_set.toml -o images
///
/// The set is described by three small files; every path is relative to the file that it stands in.
///
/// my_set.toml says what is drawn:
///
///     images = 500
///     robot  = "my_robot.toml"
///     camera = "my_camera.toml"
///     target = "arm"               # the arm whose pose is to be estimated
///     without_robot = 0.1          # the share of images of the room alone, by which a model learns to
///                                  # see that there is no arm (as all that follows, it may be left out)
///
///     # These are the defaults, but for the jitter: without it the camera stands still. Metres, radians.
///     [camera_jitter]
///     translation_m = 0.02         # the camera is up to so far from its place
///     rotation_deg  = 1.0          # and turned by up to so much, anew in each image
///     [poses]                      # joints are drawn uniformly between their limits, without collision,
///     fixed  = {}                  # but for those of a fixed value: { joint1 = 0.5 }
///     ranges = {}                  # or of a range of their own:     { joint2 = [-1.0, 1.0] }
///     camera_clearance = 0.3       # no part of an arm comes nearer to the camera
///     [visibility]
///     robot_pixels  = 300          # so many pixels of arms each image shows at least,
///     target_pixels = 300          # and so many of the target,
///     exempt_every  = 0            # unless the image's number is a multiple of this (0: never)
///     [room]
///     floor  = 0.0                 # z in the robot's root frame; no arm reaches through it, so that
///                                  # this may be a table's top as well
///     ahead  = [1.8, 3.5]          # from the camera to the walls, at least and at most
///     aside  = [1.0, 2.6]
///     behind = [1.0, 2.0]
///     height = [2.4, 3.0]          # from floor to ceiling
///     give_way = true              # walls move back where they would cut through the robot
///     [furniture]
///     closets = [0, 1]             # how many of each, at least and at most
///     shelves = [0, 1]
///     tables  = [0, 1]
///     chairs  = [0, 3]
///     clutter = [0, 3]             # heaps of boxes and balls, and things that are jointed as an arm is
///     clearance = 0.6              # none comes nearer to the camera
///
/// my_robot.toml says which arms the robot has and where the camera is:
///
///     urdf = "my.urdf"
///     [camera]
///     link = "base"                # camera_from_link takes coordinates in this link's frame to the
///     camera_from_link = [         # camera's: x right, y down, z forward
///       [0, -1,  0, 0.0],          # this camera stands 1.5 m behind the origin and 0.4 m above it
///       [0,  0, -1, 0.4],          # and looks along the link's x axis
///       [1,  0,  0, 1.5],
///       [0,  0,  0, 1  ]]
///     [[arm]]
///     name   = "arm"
///     root   = "link1"             # with all links that hang on it
///     tip    = "link7"             # errors are told by this link's origin, too
///     joints = ["joint1", "joint2"]  # those that are estimated
///
/// my_camera.toml says what the camera is like (also see data/cameras in the repository):
///
///     [intrinsics]
///     width = 640
///     height = 480
///     fx = 580.0
///     fy = 580.0
///     cx = 320.0
///     cy = 240.0
///     [range]
///     near_m = 0.5
///     far_m  = 5.0
///     [projector]                  # without it, depth is exact
///     baseline_m = 0.075
///     disparity_step_px = 0.125
///     noise.gaussian.sd_px = 0.055
///
/// The images depend on nothing but these files, the set's name and the seed. Look at
/// contact-sheet.png in the new folder: near is bright, invalid is black, the target arm is orange.
/// Where the robot never shows, or stands behind a wall, the camera's place or the room is wrong.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
struct Render {
    /// What is drawn, a TOML file
    set: PathBuf,
    /// The folder for the data set, which must be new or empty
    #[arg(short, long, value_name = "FOLDER")]
    out: PathBuf,
    /// How many images, instead of the number in SET; the first ones stay the same
    #[arg(long)]
    images: Option<usize>,
    /// Master seed of all random choices
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads to use; the images do not depend on it [default: one for each core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Command::Render(arguments) => render(arguments),
    }
}

/// The contact sheet shows at most so many images.
const SHOWN: usize = 48;

fn render(arguments: &Render) -> Result<ExitCode> {
    use_threads(arguments.threads.map(usize::from))?;
    let begin = Instant::now();
    let mut spec = SetSpec::read(&arguments.set)?;
    spec.images = arguments.images.unwrap_or(spec.images);
    tell_notes(&Rig::read(&spec.robot_path())?);
    let bar = progress_bar(spec.images as u64, "images");
    let set = generate(&spec, arguments.seed, &arguments.out, &|n| bar.inc(n));
    bar.finish_and_clear();
    let set = set?;
    let shown: Vec<usize> = (0..set.len().min(SHOWN)).collect();
    let style = SheetStyle {
        columns: 8,
        shrink: set.camera().intrinsics.width.div_ceil(160),
        tint: true,
    };
    let sheet = arguments.out.join("contact-sheet.png");
    contact_sheet(&set, &shown, style, &sheet)?;
    let records = &set.record().images;
    let moved = records.iter().filter(|image| image.walls_moved).count();
    if moved > 0 {
        eprintln!(
            "armpose: warning: in {moved} of {} images a wall or the ceiling of [room] would have cut \
             through the robot and was moved back; a larger [room] leaves it as it is drawn",
            set.len()
        );
    }
    say(&format!(
        "{} images in {}, drawn in {}; look at {}\n",
        set.len(),
        arguments.out.display(),
        duration(begin.elapsed().as_secs_f64()),
        sheet.display()
    ))?;
    Ok(ExitCode::SUCCESS)
}
