//! Pictures of estimates: the depth image in orange, the estimated arm in blue, the true one in grey
//! where it is known, as in the paper's Fig. 12.

use anyhow::{Context, Result, ensure};
use armpose::camera::{Camera, DepthImage, Image, Photographer};
use armpose::dataset::DataSet;
use armpose::experiment::figure::{Figure, Panel, PicturePanel};
use armpose::model::{Model, ModelRecord, PoseEstimate};
use armpose::scene::{ESTIMATED, KNOWN, Rig, cloud, draw_arm};
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};

type Picture = Image<[u8; 3]>;

/// The robot of a model: the one that `elsewhere` describes, or else the one that it was trained with.
pub fn rig_of(record: &ModelRecord, elsewhere: Option<&Path>) -> Result<Rig> {
    let path = elsewhere.unwrap_or(&record.robot);
    let rig = Rig::read(path).context("the model's robot is needed; --robot says where it is")?;
    ensure!(
        elsewhere.is_some() || rig.fingerprint() == record.rig,
        "{} has changed since the model was trained; train it again, or take it as it is with --robot",
        path.display()
    );
    let names: Vec<&str> = rig.robot.dof_joints().map(|j| j.name.as_str()).collect();
    let arm = rig.arm(&record.arm).map(|arm| &rig.arms[arm]);
    let fits = arm.is_some_and(|arm| {
        let joints = arm.joints.iter().map(|&dof| names[dof]);
        joints.eq(record.joints.iter().map(|joint| joint.name.as_str()))
    });
    ensure!(
        fits,
        "{} has no arm \"{}\" with the joints of the model",
        path.display(),
        record.arm
    );
    Ok(rig)
}

/// Draws pictures into a folder.
pub struct Overlays<'a> {
    folder: PathBuf,
    record: &'a ModelRecord,
    rig: &'a Rig,
    arm: usize,
    camera_from_root: Isometry3<f64>,
    photographer: Photographer,
    /// Pictures so far.
    drawn: usize,
}

impl<'a> Overlays<'a> {
    pub fn new(folder: &Path, model: &'a Model, rig: &'a Rig) -> Result<Overlays<'a>> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot write {}", folder.display()))?;
        let record = model.record();
        let camera = Camera {
            intrinsics: record.intrinsics,
            range: record.range,
            projector: None,
        };
        Ok(Overlays {
            folder: folder.to_owned(),
            record,
            rig,
            arm: rig.arm(&record.arm).context("the robot lost its arm")?,
            camera_from_root: model.camera_from_root(),
            photographer: Photographer::new(&camera),
            drawn: 0,
        })
    }

    /// Draws an image of a data set, whose true pose is known. `depth` is what the model sees of it.
    pub fn draw_beside_truth(
        &mut self,
        set: &DataSet,
        image: usize,
        depth: &DepthImage,
        pose: Option<&PoseEstimate>,
    ) -> Result<()> {
        let mut picture = cloud(depth, &self.record.range);
        let camera_from_root = set.camera_from_root_of(image);
        let mut configuration = self.rig.robot.rest();
        if !set.record().images[image].without_robot {
            configuration = set.configuration(image, &self.rig.robot)?;
            self.draw(&mut picture, &configuration, camera_from_root, KNOWN);
        }
        self.draw_pose(&mut picture, configuration, camera_from_root, pose);
        self.write(
            &format!("{image:06}"),
            "estimate blue, truth grey",
            picture,
            pose,
        )
    }

    /// Draws an image that somebody took, from where the training images were taken: the joints that are
    /// not estimated rest.
    pub fn draw_estimate(
        &mut self,
        image: &Path,
        depth: &DepthImage,
        pose: Option<&PoseEstimate>,
    ) -> Result<()> {
        let mut picture = cloud(depth, &self.record.range);
        let rest = self.rig.robot.rest();
        let camera_from_root = self.camera_from_root;
        self.draw_pose(&mut picture, rest, &camera_from_root, pose);
        let stem = image.file_stem().unwrap_or_default().to_string_lossy();
        // Images of different folders may have the same name.
        let name = format!("{:04}-{stem}", self.drawn);
        self.drawn += 1;
        self.write(&name, "estimate blue", picture, pose)
    }

    fn draw_pose(
        &mut self,
        picture: &mut Picture,
        mut configuration: Vec<f64>,
        camera_from_root: &Isometry3<f64>,
        pose: Option<&PoseEstimate>,
    ) {
        if let Some(pose) = pose {
            for (&dof, &value) in self.rig.arms[self.arm].joints.iter().zip(&pose.values) {
                configuration[dof] = value;
            }
            self.draw(picture, &configuration, camera_from_root, ESTIMATED);
        }
    }

    fn draw(
        &mut self,
        picture: &mut Picture,
        configuration: &[f64],
        camera_from_root: &Isometry3<f64>,
        colour: [u8; 3],
    ) {
        let arm = (self.rig, self.arm);
        let photographer = &mut self.photographer;
        draw_arm(
            picture,
            photographer,
            arm,
            configuration,
            camera_from_root,
            colour,
        );
    }

    fn write(
        &self,
        name: &str,
        legend: &str,
        picture: Picture,
        pose: Option<&PoseEstimate>,
    ) -> Result<()> {
        let caption = match pose {
            None => "the arm is not visible".to_owned(),
            Some(pose) => {
                let joints = self.record.joints.iter().zip(&pose.values);
                let texts = joints.map(|(j, v)| format!("{} {v:.2} {}", j.name, j.unit.name()));
                texts.collect::<Vec<_>>().join(", ")
            }
        };
        let picture = enlarged(picture);
        let figure = Figure {
            title: format!("{}: {legend}", shortened(name)),
            caption,
            size: (picture.width as u32 + 60, picture.height as u32 + 220),
            panels: vec![Panel::Picture(PicturePanel {
                title: String::new(),
                image: picture,
            })],
            columns: 1,
        };
        let path = self.folder.join(format!("{name}.png"));
        std::fs::write(&path, figure.png()?)
            .with_context(|| format!("cannot write {}", path.display()))
    }
}

/// Small pictures are shown larger by a whole number, so that title and joints fit below and above.
fn enlarged(picture: Picture) -> Picture {
    const LEAST_WIDTH: usize = 600;
    let times = LEAST_WIDTH.div_ceil(picture.width.max(1));
    let (width, height) = (picture.width * times, picture.height * times);
    let pixel = |at: usize| picture.pixels[at / width / times * picture.width + at % width / times];
    Image {
        width,
        height,
        pixels: (0..width * height).map(pixel).collect(),
    }
}

/// The end of a name that is too long for a title.
fn shortened(name: &str) -> String {
    const LONGEST: usize = 24;
    let letters: Vec<char> = name.chars().collect();
    match letters.len() <= LONGEST {
        true => name.to_owned(),
        false => letters[letters.len() - LONGEST + 1..]
            .iter()
            .fold("\u{2026}".to_owned(), |text, letter| {
                text + &letter.to_string()
            }),
    }
}
