//! What one camera would have seen of the image that another one took from the same place.

use super::{DepthImage, Intrinsics, Lens};

/// For each pixel of a view, where in images of another camera the nearest ray is found. The cameras
/// stand at the same place and look the same way, so that z-depth stays what it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Resampling {
    to: Intrinsics,
    from: Intrinsics,
    /// By pixel of the view; [`OUTSIDE`] where the other camera does not look.
    sources: Vec<u32>,
}

const OUTSIDE: u32 = u32::MAX;

impl Resampling {
    /// From images of `from` to those of `to`; the distortion of `from` is taken out.
    pub fn new(from: &Lens, to: &Intrinsics) -> Resampling {
        let Lens {
            intrinsics: from,
            distortion,
        } = from;
        // Where a coordinate of the ray is found; `None` outside.
        let place = |ray: f64, [c, f]: [f64; 2], size: usize| {
            let place = (ray * f + c).round();
            (0.0..size as f64)
                .contains(&place)
                .then_some(place as usize)
        };
        let source = |x: usize, y: usize| {
            let (x, y) = ((x as f64 - to.cx) / to.fx, (y as f64 - to.cy) / to.fy);
            let [x, y] = distortion.apply(x, y)?;
            let column = place(x, [from.cx, from.fx], from.width)?;
            let row = place(y, [from.cy, from.fy], from.height)?;
            Some((row * from.width + column) as u32)
        };
        let of_row = |y| (0..to.width).map(move |x| source(x, y).unwrap_or(OUTSIDE));
        Resampling {
            to: *to,
            from: *from,
            sources: (0..to.height).flat_map(of_row).collect(),
        }
    }

    /// The share of the view that images of the other camera cover, 0 to 1.
    pub fn covered(&self) -> f64 {
        let inside = self.sources.iter().filter(|&&at| at != OUTSIDE).count();
        inside as f64 / self.sources.len() as f64
    }

    /// The image as the view sees it: invalid where the other camera does not look. Panics when it is not
    /// of that camera's size.
    pub fn apply(&self, image: &DepthImage) -> DepthImage {
        let Intrinsics { width, height, .. } = self.from;
        assert_eq!((image.width, image.height), (width, height), "size");
        let pixel = |&at: &u32| match at {
            OUTSIDE => 0,
            at => image.pixels[at as usize],
        };
        DepthImage {
            width: self.to.width,
            height: self.to.height,
            pixels: self.sources.iter().map(pixel).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, stream, uniform};

    const VIEW: Intrinsics = Intrinsics {
        width: 64,
        height: 48,
        fx: 58.0,
        fy: 57.0,
        cx: 31.3,
        cy: 24.4,
    };

    #[test]
    fn a_camera_sees_its_own_images_as_they_are() {
        let mut random = stream(1, "resample", &[]);
        let image = DepthImage {
            width: 64,
            height: 48,
            pixels: (0..64 * 48)
                .map(|_| below(&mut random, 5000) as u16)
                .collect(),
        };
        let same = Resampling::new(&(&VIEW).into(), &VIEW);
        assert_eq!(same.covered(), 1.0);
        assert_eq!(same.apply(&image), image);
    }

    /// The depth at the pixel of a tilted plane: its inverse is linear in the ray.
    fn plane(camera: &Intrinsics) -> DepthImage {
        let depth = |at: usize| {
            let (x, y) = ((at % camera.width) as f64, (at / camera.width) as f64);
            let (x, y) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
            (1000.0 / (0.5 + 0.1 * x - 0.15 * y)).round() as u16
        };
        DepthImage {
            width: camera.width,
            height: camera.height,
            pixels: (0..camera.width * camera.height).map(depth).collect(),
        }
    }

    /// Whatever camera took it, a plane stays where it is: to half a pixel of that camera.
    #[test]
    fn a_plane_is_the_same_plane_for_every_camera() {
        let mut random = stream(2, "resample", &[]);
        for _ in 0..20 {
            let zoom = uniform(&mut random, 0.5, 2.0);
            let other = Intrinsics {
                width: (80.0 * zoom) as usize,
                height: (60.0 * zoom) as usize,
                fx: 58.0 * zoom,
                fy: 57.0 * zoom,
                cx: 39.0 * zoom + uniform(&mut random, -2.0, 2.0),
                cy: 30.0 * zoom + uniform(&mut random, -2.0, 2.0),
            };
            let resampling = Resampling::new(&(&other).into(), &VIEW);
            assert_eq!(resampling.covered(), 1.0);
            let seen = resampling.apply(&plane(&other));
            // Half a pixel of at most 1 / 28 along a slope of at most 0.18 / m.
            let bound = |mm: u16| 1.0 + f64::from(mm).powi(2) / 1000.0 * 0.25 * 0.5 / (28.0 * 1.0);
            for (&got, &truth) in seen.pixels.iter().zip(&plane(&VIEW).pixels) {
                let error = (f64::from(got) - f64::from(truth)).abs();
                assert!(error <= bound(truth), "{got} {truth}");
            }
        }
    }

    #[test]
    fn what_is_not_covered_is_invalid() {
        let left = Intrinsics { width: 32, ..VIEW };
        let resampling = Resampling::new(&(&left).into(), &VIEW);
        assert_eq!(resampling.covered(), 0.5);
        let seen = resampling.apply(&plane(&left));
        let whole = plane(&VIEW);
        for at in 0..seen.pixels.len() {
            let expected = if at % 64 < 32 { whole.pixels[at] } else { 0 };
            assert_eq!(seen.pixels[at], expected);
        }
    }
}
