//! Takes the images of a data set, one by one, in memory.

use super::record::{ImageRecord, rows};
use super::{DataSetError, SetSpec};
use crate::camera::{Camera, Photo, Photographer};
use crate::random::{Stream, below, stream, uniform};
use crate::scene::{
    CameraJitter, OrientedBox, PoseSampler, Rig, RobotPlace, SelfCollision, check_view, furnish,
    robot_bodies, room_body,
};
use nalgebra::{Isometry3, Point3};

/// So many frames are drawn for an image before its specification is given up.
const TRIES: usize = 2_000;

/// Everything that stays the same from image to image of a data set.
pub struct Studio<'a> {
    pub(super) spec: &'a SetSpec,
    pub(super) rig: Rig,
    pub(super) camera: Camera,
    /// Index of the target arm.
    pub(super) target: usize,
    poses: PoseSampler,
    collision: SelfCollision,
    /// The nominal one.
    pub(super) camera_from_root: Isometry3<f64>,
}

/// What an image is drawn from. The jitter has a stream of its own, so that poses do not depend on it.
struct Streams {
    frames: Stream,
    jitter: Stream,
}

impl Streams {
    fn new(seed: u64, set: &str, image: usize) -> Self {
        let of = |what: &str| stream(seed, &format!("{what} of {set}"), &[image as u64]);
        Streams {
            frames: of("frames"),
            jitter: of("camera jitter"),
        }
    }
}

/// An image and the truth about it.
pub struct Shot {
    /// The values of all joints, as [`crate::robot::Robot`] orders them; `None` without the robot.
    pub configuration: Option<Vec<f64>>,
    pub photo: Photo,
    pub record: ImageRecord,
}

impl<'a> Studio<'a> {
    /// Reads the robot and the camera that a specification names.
    pub fn read(spec: &'a SetSpec) -> Result<Self, DataSetError> {
        let rig = Rig::read(&spec.robot_path())?;
        let camera = Camera::read(&spec.camera_path())?;
        Self::new(spec, rig, camera)
    }

    /// Of a robot and a camera that have been read already.
    pub fn new(spec: &'a SetSpec, rig: Rig, camera: Camera) -> Result<Self, DataSetError> {
        spec.check()?;
        let target = rig.arm(&spec.target).ok_or_else(|| DataSetError::Spec {
            set: spec.name.clone(),
            message: format!("the robot has no arm \"{}\" to be the target", spec.target),
        })?;
        let poses = PoseSampler::new(&rig, &spec.poses)?;
        let sample = |stream: &mut Stream| poses.sample(&rig.robot, stream);
        let some: Vec<Vec<f64>> = (0..64)
            .map(|i| sample(&mut stream(0, "view", &[i])))
            .collect();
        check_view(&rig, target, &camera.intrinsics, &some)?;
        let collision = SelfCollision::new(&rig.robot, sample);
        // The camera stands still, so that any configuration tells where.
        let any = sample(&mut stream(0, "camera", &[]));
        let camera_from_root = rig.camera_from_root(&rig.robot.forward_kinematics(&any));
        let height = camera_from_root.inverse().translation.z - spec.room.floor;
        if !(height > 0.0 && height < spec.room.height[0]) {
            return Err(DataSetError::Spec {
                set: spec.name.clone(),
                message: format!(
                    "the camera stands {height:.2} m above room.floor, which is not between floor and \
                     ceiling; room.floor is a height in the robot's root frame, room.height the least \
                     and greatest height of the ceiling above it"
                ),
            });
        }
        Ok(Studio {
            spec,
            rig,
            camera,
            target,
            poses,
            collision,
            camera_from_root,
        })
    }

    /// The camera that images are taken with.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Takes an image, which depends on nothing but the specification, the seed and its number. Frames are
    /// drawn until one is free of collision and shows what the specification demands. `photographer` is
    /// one of this camera.
    pub fn shoot(
        &self,
        image: usize,
        photographer: &mut Photographer,
        seed: u64,
    ) -> Result<Shot, DataSetError> {
        let mut streams = Streams::new(seed, &self.spec.name, image);
        if self.spec.is_without_robot(image) {
            return Ok(self.shoot_room(photographer, streams));
        }
        let Streams { frames, jitter } = &mut streams;
        let admits = |pixels: &[usize]| self.spec.admits(image, pixels, self.target);
        let mut record = ImageRecord::default();
        for _ in 0..TRIES {
            let camera_from_root = self.jittered(jitter);
            let root_from_camera = camera_from_root.inverse();
            let configuration = self.poses.sample(&self.rig.robot, frames);
            let root_from_link = self.rig.robot.forward_kinematics(&configuration);
            let boxes = self.collision.boxes(&root_from_link);
            let camera = Point3::from(root_from_camera.translation.vector);
            if self.collision.first(&root_from_link, &boxes).is_some()
                || self.is_near(&camera, &boxes)
                || self.is_below_floor(&boxes)
            {
                record.collided += 1;
                continue;
            }
            // Most poses are out of view: the exact drawing of the robot alone tells it cheaply.
            let mut bodies = robot_bodies(&self.rig, &root_from_link, &camera_from_root);
            let alone = photographer.draw(&bodies);
            let in_range = |&z: &f32| {
                (self.camera.range.near_m..=self.camera.range.far_m).contains(&f64::from(z))
            };
            let visible = alone.depth.pixels.iter().map(in_range);
            if !admits(&self.arm_pixels(visible, &alone.labels.pixels)) {
                record.hidden += 1;
                continue;
            }
            let (room, furniture) = (&self.spec.room, &self.spec.furniture);
            let place = RobotPlace::Taken(&boxes);
            let background = furnish(room, furniture, &root_from_camera, place, frames);
            record.walls_moved = background.walls_moved;
            bodies.push(room_body(&background.mesh, &camera_from_root));
            let photo = photographer.photograph(&bodies, frames);
            let valid = photo.depth.pixels.iter().map(|&mm| mm > 0);
            record.valid = valid.clone().filter(|&v| v).count();
            record.arms = self.arm_pixels(valid, &photo.labels.pixels);
            if admits(&record.arms) {
                record.camera_from_root = self.told(&camera_from_root);
                return Ok(Shot {
                    configuration: Some(configuration),
                    photo,
                    record,
                });
            }
            record.hidden += 1;
        }
        Err(DataSetError::NoFrame {
            set: self.spec.name.clone(),
            image,
            tries: TRIES,
            collided: record.collided,
        })
    }

    /// An image of the room, without the robot and with other things where it would stand. Every second
    /// one is taken from somewhere else, and every fourth shows nothing beyond some distance, as of a
    /// camera whose range is shorter: there are more scenes without the robot than with it.
    fn shoot_room(&self, photographer: &mut Photographer, mut streams: Streams) -> Shot {
        let Streams { frames, jitter } = &mut streams;
        let camera_from_root = match below(jitter, 2) {
            0 => self.jittered(jitter),
            _ => self.elsewhere(jitter),
        };
        let configuration = self.poses.sample(&self.rig.robot, frames);
        let boxes = (self.collision).boxes(&self.rig.robot.forward_kinematics(&configuration));
        let (room, furniture) = (&self.spec.room, &self.spec.furniture);
        let root_from_camera = camera_from_root.inverse();
        let place = RobotPlace::Free(&boxes);
        let background = furnish(room, furniture, &root_from_camera, place, frames);
        let body = room_body(&background.mesh, &camera_from_root);
        let mut photo = photographer.photograph(&[body], frames);
        if below(frames, 4) == 0 {
            // At least a fifth of what is valid stays.
            let mut depths = photo.depth.pixels.clone();
            depths.retain(|&mm| mm > 0);
            depths.sort_unstable();
            let farthest = (uniform(frames, 0.2, 1.0) * depths.len() as f64) as usize;
            let farthest = depths.get(farthest).copied().unwrap_or(u16::MAX);
            let beyond = |mm: &&mut u16| **mm > farthest;
            photo
                .depth
                .pixels
                .iter_mut()
                .filter(beyond)
                .for_each(|mm| *mm = 0);
        }
        Shot {
            configuration: None,
            record: ImageRecord {
                valid: photo.depth.pixels.iter().filter(|&&mm| mm > 0).count(),
                arms: vec![0; self.rig.arms.len()],
                camera_from_root: Some(rows(&camera_from_root.to_homogeneous())),
                without_robot: true,
                ..ImageRecord::default()
            },
            photo,
        }
    }

    /// Where an image is taken from, `camera_from_root`.
    fn jittered(&self, jitter: &mut Stream) -> Isometry3<f64> {
        match &self.spec.camera_jitter {
            Some(spec) => spec.sample(jitter) * self.camera_from_root,
            None => self.camera_from_root,
        }
    }

    /// A camera far from its place, above the floor and below the ceiling.
    fn elsewhere(&self, jitter: &mut Stream) -> Isometry3<f64> {
        const FAR: CameraJitter = CameraJitter {
            translation_m: 0.8,
            rotation_deg: 60.0,
        };
        let room = &self.spec.room;
        let draw = |_| FAR.sample(jitter) * self.camera_from_root;
        let is_inside = |camera_from_root: &Isometry3<f64>| {
            let height = camera_from_root.inverse().translation.z - room.floor;
            (0.1..room.height[0]).contains(&height)
        };
        let found = (0..100).map(draw).find(is_inside);
        found.unwrap_or(self.camera_from_root)
    }

    /// What [`ImageRecord::camera_from_root`] says.
    fn told(&self, camera_from_root: &Isometry3<f64>) -> Option<[[f64; 4]; 4]> {
        let jitter = self.spec.camera_jitter.as_ref();
        jitter.map(|_| rows(&camera_from_root.to_homogeneous()))
    }

    /// Whether an arm comes nearer to the camera than the specification allows.
    fn is_near(&self, camera: &Point3<f64>, boxes: &[Vec<OrientedBox>]) -> bool {
        let clearance = self.spec.poses.camera_clearance;
        let arms = self.rig.arms.iter().flat_map(|arm| &arm.links);
        arms.flat_map(|&link| &boxes[link])
            .any(|part| part.distance(camera) < clearance)
    }

    /// Whether an arm reaches through the floor. Its root link may: that is what it is mounted by.
    fn is_below_floor(&self, boxes: &[Vec<OrientedBox>]) -> bool {
        let links = self.rig.arms.iter().flat_map(|arm| &arm.links[1..]);
        let corners = links
            .flat_map(|&link| &boxes[link])
            .flat_map(|part| part.corners());
        corners
            .into_iter()
            .any(|corner| corner.z < self.spec.room.floor)
    }

    /// How many of the valid pixels show each arm.
    fn arm_pixels(&self, valid: impl Iterator<Item = bool>, labels: &[u8]) -> Vec<usize> {
        let mut by_label = [0; 256];
        for (valid, &label) in valid.zip(labels) {
            by_label[usize::from(label)] += usize::from(valid);
        }
        let pixels = |arm: &crate::scene::Arm| {
            arm.links
                .iter()
                .map(|&link| by_label[usize::from(self.rig.label(link))])
                .sum()
        };
        self.rig.arms.iter().map(pixels).collect()
    }
}
