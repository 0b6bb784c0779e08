//! From bodies to a depth image: draw, find what the projector lights, measure disparity.

use super::filter::WindowFilter;
use super::noise::NoiseField;
use super::rasteriser::{CameraView, ProjectorView, Rasteriser};
use super::{Body, Camera, DepthImage, Image, LabelImage, Projector};
use crate::random::Stream;

/// An exact view.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// z-depth in metres; infinite where nothing is seen.
    pub depth: Image<f32>,
    /// Label of the surface seen at each pixel.
    pub labels: LabelImage,
}

/// What the camera delivers, and the truth about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Photo {
    pub depth: DepthImage,
    /// Label of the surface seen at each pixel, whether its depth is valid or not.
    pub labels: LabelImage,
}

/// Takes photos, one after the other; each thread has its own photographer. Holds the memory that
/// frames share, the dot pattern included.
pub struct Photographer {
    camera: Camera,
    rasteriser: Rasteriser,
    view: CameraView,
    sensor: Option<Sensor>,
}

/// The projector's part of a photographer.
struct Sensor {
    projector: Projector,
    width: usize,
    view: ProjectorView,
    /// Disparity in steps, 0 = none.
    codes: Vec<u16>,
    filter: WindowFilter,
    /// For each code, the depth in mm; 0 for a depth out of range.
    depth_of_code: Vec<u16>,
}

impl Photographer {
    /// Takes the memory of a frame, and draws the dot pattern.
    pub fn new(camera: &Camera) -> Photographer {
        let intrinsics = camera.intrinsics;
        let (width, height) = (intrinsics.width, intrinsics.height);
        Photographer {
            camera: *camera,
            rasteriser: Rasteriser::new(intrinsics),
            view: CameraView::new(&intrinsics),
            sensor: camera.projector.map(|projector| Sensor {
                projector,
                width,
                view: ProjectorView::new(&intrinsics, projector.baseline_m, camera.range.near_m),
                codes: vec![0; width * height],
                filter: WindowFilter::new(width, height, projector.disparity_step_px),
                depth_of_code: depths_of_codes(camera, &projector),
            }),
        }
    }

    /// Draws without a sensor: exact depth at pixel centres, at any distance beyond 0.05 m.
    pub fn draw(&mut self, bodies: &[Body]) -> Drawing {
        self.rasteriser.draw(bodies, &mut self.view, None);
        let metres = |inverse: &f32| 1.0 / inverse;
        Drawing {
            depth: self.image(self.view.inverse_depth().iter().map(metres).collect()),
            labels: self.image(self.view.labels()),
        }
    }

    /// Draws and measures. The noise of the sensor draws from `noise`.
    pub fn photograph(&mut self, bodies: &[Body], noise: &mut Stream) -> Photo {
        let projector_view = self.sensor.as_mut().map(|sensor| &mut sensor.view);
        self.rasteriser.draw(bodies, &mut self.view, projector_view);
        let seen = self.view.inverse_depth();
        let depth = match &mut self.sensor {
            Some(sensor) => sensor.measure(seen, noise),
            None => {
                let depth = |&inverse: &f32| millimetres(1.0 / f64::from(inverse), &self.camera);
                seen.iter().map(depth).collect()
            }
        };
        Photo {
            depth: self.image(depth),
            labels: self.image(self.view.labels()),
        }
    }

    /// Which surfaces get a disparity before the filter: what lies beyond the near end of the range
    /// and the projector lights. Without a projector, everything that is seen.
    pub fn lit(&mut self, bodies: &[Body]) -> Image<bool> {
        let projector_view = self.sensor.as_mut().map(|sensor| &mut sensor.view);
        self.rasteriser.draw(bodies, &mut self.view, projector_view);
        let seen = self.view.inverse_depth();
        let lit = match &mut self.sensor {
            Some(sensor) => sensor
                .disparities(seen)
                .iter()
                .map(|&code| code > 0)
                .collect(),
            None => seen.iter().map(|&inverse| inverse > 0.0).collect(),
        };
        self.image(lit)
    }

    fn image<T>(&self, pixels: Vec<T>) -> Image<T> {
        Image {
            width: self.camera.intrinsics.width,
            height: self.camera.intrinsics.height,
            pixels,
        }
    }
}

impl Sensor {
    /// The disparity of each pixel, whose inverse depths are `seen`, before the filter.
    fn disparities(&mut self, seen: &[f32]) -> &[u16] {
        let step = self.projector.disparity_step_px;
        let codes = self.codes.chunks_exact_mut(self.width);
        for (row, (seen, codes)) in seen.chunks_exact(self.width).zip(codes).enumerate() {
            self.view.disparities(row, seen, step, codes);
        }
        &self.codes
    }

    /// Depth in mm of each pixel, whose inverse depths are `seen`.
    fn measure(&mut self, seen: &[f32], noise: &mut Stream) -> Vec<u16> {
        self.disparities(seen);
        let step = self.projector.disparity_step_px;
        let mut field = NoiseField::new(self.projector.noise, noise);
        let disturb = |column, row, code| {
            let moved = f64::from(code) + field.at(column, row) / step;
            (moved + 0.5) as u16
        };
        let mut depth = vec![0; seen.len()];
        self.filter.apply(&self.codes, disturb, |pixel, code| {
            let mm = self.depth_of_code.get(usize::from(code));
            depth[pixel] = mm.copied().unwrap_or(0);
        });
        depth
    }
}

/// z = f b / disparity for each number of steps that the range allows.
fn depths_of_codes(camera: &Camera, projector: &Projector) -> Vec<u16> {
    let focal_baseline = camera.intrinsics.fx * projector.baseline_m;
    let steps = focal_baseline / camera.range.near_m / projector.disparity_step_px;
    (0..=steps as u32)
        .map(|code| focal_baseline / (f64::from(code) * projector.disparity_step_px))
        .map(|metres| millimetres(metres, camera))
        .collect()
}

/// Depths out of the camera's range are 0.
fn millimetres(metres: f64, camera: &Camera) -> u16 {
    if metres >= camera.range.near_m && metres <= camera.range.far_m {
        (metres * 1000.0).round() as u16
    } else {
        0
    }
}
