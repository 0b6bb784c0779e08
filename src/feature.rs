//! Depth-difference features (eq. 4) and the matrix of their values.
//!
//! A feature is the difference of the depths at two fixed offsets from a pixel. The offsets are in
//! pixels and are not scaled by depth; a place that is invalid or outside the image counts as
//! [`D_INVALID_MM`]. Other features may follow these, see [`Extra`]. All values fit an `i16`; depths
//! are millimetres.

use crate::camera::{DepthImage, Image};
use crate::random::{Stream, below};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The depth of what cannot be seen. Depths beyond it are clamped to it.
pub const D_INVALID_MM: i16 = 5000;

/// How many neighbours of a row a tree looks at together: what fits two vectors of 128 bits, which every
/// x86-64 has.
pub const LANES: usize = 16;

/// A window wider than this is taken for a mistake: it would cost gigabytes of border.
const MAX_WINDOW: usize = 2000;
/// A tree's node holds its feature in 16 bits, and the last value marks a leaf.
const MAX_COUNT: usize = u16::MAX as usize;

/// Numbers that cannot be met.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FeatureError {
    #[error("{0} features were asked for; ask for 1 to {MAX_COUNT}")]
    Count(usize),
    #[error("a feature window of {0} pixels was asked for; ask for 1 to {MAX_WINDOW}")]
    Window(usize),
}

/// How many features are drawn, and the side in pixels of the square window around the pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeatureSpec {
    pub count: usize,
    pub window: usize,
}

/// Which features follow those of eq. 4.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Extra {
    #[default]
    Nothing,
    /// The pixel's column, row and depth (section III-D).
    Pixel,
    /// For each feature of eq. 4 the value of a second image, the context, at delta_u (end of
    /// section III-D).
    Context,
}

/// The offsets (x, y) of delta_u and delta_v of each feature, pixels, and what follows them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct DepthFeatures {
    offsets: Vec<[[i16; 2]; 2]>,
    extra: Extra,
}

/// As features stand in a model file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    offsets: Vec<[[i16; 2]; 2]>,
    extra: Extra,
}

impl TryFrom<Written> for DepthFeatures {
    type Error = FeatureError;

    fn try_from(Written { offsets, extra }: Written) -> Result<Self, FeatureError> {
        Self::new(offsets, extra)
    }
}

impl From<DepthFeatures> for Written {
    fn from(DepthFeatures { offsets, extra }: DepthFeatures) -> Self {
        Self { offsets, extra }
    }
}

impl DepthFeatures {
    /// Features with these offsets. Fails when there are none or too many, or when they reach too far.
    pub fn new(offsets: Vec<[[i16; 2]; 2]>, extra: Extra) -> Result<Self, FeatureError> {
        let features = Self { offsets, extra };
        if features.offsets.is_empty() || features.count() > MAX_COUNT {
            return Err(FeatureError::Count(features.count()));
        }
        if 2 * features.reach() > MAX_WINDOW {
            return Err(FeatureError::Window(2 * features.reach()));
        }
        Ok(features)
    }

    /// Offsets uniform over the integers of `[-window/2, window/2)`, in x and in y.
    pub fn draw(
        spec: &FeatureSpec,
        extra: Extra,
        stream: &mut Stream,
    ) -> Result<Self, FeatureError> {
        if !(1..=MAX_WINDOW).contains(&spec.window) {
            return Err(FeatureError::Window(spec.window));
        }
        if !(1..=MAX_COUNT).contains(&spec.count) {
            return Err(FeatureError::Count(spec.count));
        }
        let mut offset = || (below(stream, spec.window) as i32 - (spec.window / 2) as i32) as i16;
        let offsets = (0..spec.count)
            .map(|_| [[offset(), offset()], [offset(), offset()]])
            .collect();
        Self::new(offsets, extra)
    }

    /// How many there are, the extra ones included.
    pub fn count(&self) -> usize {
        self.offsets.len()
            + match self.extra {
                Extra::Nothing => 0,
                Extra::Pixel => 3,
                Extra::Context => self.offsets.len(),
            }
    }

    /// What follows the features of eq. 4.
    pub fn extra(&self) -> Extra {
        self.extra
    }

    /// The offsets (x, y) of delta_u and delta_v of each feature of eq. 4, pixels.
    pub fn offsets(&self) -> &[[[i16; 2]; 2]] {
        &self.offsets
    }

    /// The largest distance in x or y that a feature looks away from its pixel: the margin that a
    /// [`PaddedDepth`] needs.
    pub fn reach(&self) -> usize {
        let all = self.offsets.iter().flatten().flatten();
        all.map(|o| usize::from(o.unsigned_abs()))
            .max()
            .unwrap_or(0)
    }

    /// Joins the features to one image. Panics when the image's margin is below [`Self::reach`], or
    /// when it lacks the context that they ask for.
    pub fn on<'a>(&self, image: &'a PaddedDepth) -> FeaturesOnImage<'a> {
        assert!(
            self.reach() <= image.margin,
            "the image's margin is too small"
        );
        assert!(
            self.extra != Extra::Context || image.context.len() == image.values.len(),
            "the image has no context"
        );
        let corner = image.corner() as i32;
        let (row, plane, step) = (image.row as i32, image.plane as i32, image.step as i32);
        let linear = |[x, y]: [i16; 2]| {
            let (x, y) = (i32::from(x), i32::from(y));
            (corner + y * row + x.rem_euclid(step) * plane + x.div_euclid(step)) as u32
        };
        let (mut columns, mut rows) = (vec![], vec![]);
        if self.extra == Extra::Pixel {
            let row: Vec<i16> = (0..image.row).map(|at| (at * image.step) as i16).collect();
            // As many rows more as lie behind the last position however narrow the image is.
            columns = row.repeat(image.height + LANES);
            rows = vec![0; columns.len()];
            for (row, values) in rows.chunks_exact_mut(image.row).enumerate() {
                values.fill(row as i16);
            }
        }
        FeaturesOnImage {
            image,
            offsets: self.offsets.iter().map(|o| o.map(linear)).collect(),
            extra: self.extra,
            columns,
            rows,
        }
    }

    /// Writes the value of feature f at each of `positions` (see [`PaddedDepth::position`]) into
    /// `columns[f]`.
    pub fn fill(&self, image: &PaddedDepth, positions: &[u32], columns: &mut [&mut [i16]]) {
        let features = self.on(image);
        for (feature, column) in columns.iter_mut().take(self.count()).enumerate() {
            let (minuend, subtrahend) = features.operands(feature);
            for (value, &position) in column.iter_mut().zip(positions) {
                let at = position as usize;
                *value = minuend[at] - subtrahend.map_or(0, |values| values[at]);
            }
        }
    }
}

/// A depth image with a border on all sides, in which invalid pixels and the border hold
/// [`D_INVALID_MM`], so that a feature is the difference of two elements and nothing else. Behind the last
/// one there are some more, so that [`LANES`] may be looked at from any pixel on.
///
/// With a step of 2 the even columns of a row stand first, then the odd ones: every second pixel has the
/// next one looked at beside it, and so has everything at an offset from them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PaddedDepth {
    values: Vec<i16>,
    /// A second image with the same border, zero there; empty without one.
    context: Vec<i16>,
    step: usize,
    /// Elements of a row, and of its columns that have the same remainder divided by the step.
    row: usize,
    plane: usize,
    width: usize,
    height: usize,
    margin: usize,
}

impl PaddedDepth {
    /// A copy of an image (mm, 0 = invalid) with a border of `margin` pixels, at least
    /// [`DepthFeatures::reach`] of the features that will look at it.
    pub fn new(image: &DepthImage, margin: usize) -> Self {
        Self::every(1, image, margin)
    }

    /// The same for whoever looks at the pixels of every `step`-th column only. Panics when it is 0.
    pub fn every(step: usize, image: &DepthImage, margin: usize) -> Self {
        assert!(step > 0, "a step of 0");
        let mut padded = Self {
            step,
            ..Self::default()
        };
        padded.refill(image, margin);
        padded
    }

    /// Adds the second image that [`Extra::Context`] looks at. Panics when its size is another.
    pub fn with_context(mut self, map: &Image<u8>) -> Self {
        assert_eq!((map.width, map.height), (self.width, self.height));
        let mut context = vec![0; self.values.len()];
        self.spread(&mut context, &map.pixels, i16::from);
        self.context = context;
        self
    }

    /// Takes another image, in the memory of the last one, and without context.
    pub fn refill(&mut self, image: &DepthImage, margin: usize) {
        self.step = self.step.max(1);
        (self.width, self.height, self.margin) = (image.width, image.height, margin);
        self.plane = (image.width + margin).div_ceil(self.step) + self.planes_margin();
        self.row = self.plane * self.step;
        self.context.clear();
        let mut values = std::mem::take(&mut self.values);
        values.clear();
        values.resize(self.row * (image.height + 2 * margin) + LANES, D_INVALID_MM);
        self.spread(&mut values, &image.pixels, |depth: u16| match depth {
            0 => D_INVALID_MM,
            mm => mm.min(D_INVALID_MM as u16) as i16,
        });
        self.values = values;
    }

    /// How many elements of a plane lie left of the image.
    fn planes_margin(&self) -> usize {
        self.margin.div_ceil(self.step)
    }

    /// Writes the pixels of an image to their places.
    fn spread<T: Copy>(&self, values: &mut [i16], pixels: &[T], value: impl Fn(T) -> i16) {
        let rows = values.chunks_exact_mut(self.row).skip(self.margin);
        for (row, source) in rows.zip(pixels.chunks_exact(self.width)) {
            let planes = row.chunks_exact_mut(self.plane);
            for (first, plane) in planes.enumerate().take(self.width) {
                let plane = plane[self.planes_margin()..].iter_mut();
                for (to, &from) in plane.zip(source[first..].iter().step_by(self.step)) {
                    *to = value(from);
                }
            }
        }
    }

    /// Where column `x`, row `y` of the image stands: the index of the top left corner of the
    /// window of side `2 margin + 1` around it. Panics outside the image, and between the columns that
    /// are looked at.
    pub fn position(&self, x: usize, y: usize) -> u32 {
        assert!(x < self.width && y < self.height, "pixel outside the image");
        assert!(x.is_multiple_of(self.step), "pixel between the steps");
        (y * self.row + x / self.step) as u32
    }

    /// Where the pixel with this number stands, counted row by row. Panics outside the image.
    pub fn position_of(&self, pixel: usize) -> u32 {
        self.position(pixel % self.width, pixel / self.width)
    }

    /// The depth at a position, mm.
    pub fn depth(&self, position: u32) -> i16 {
        self.values[position as usize + self.corner()]
    }

    /// How far behind its position the value of a pixel stands.
    fn corner(&self) -> usize {
        self.margin * self.row + self.planes_margin()
    }
}

/// Features at fixed linear offsets into the values of one image.
#[derive(Debug, Clone)]
pub struct FeaturesOnImage<'a> {
    image: &'a PaddedDepth,
    offsets: Vec<[u32; 2]>,
    extra: Extra,
    /// Of each position; empty without [`Extra::Pixel`].
    columns: Vec<i16>,
    rows: Vec<i16>,
}

impl FeaturesOnImage<'_> {
    /// The value of `feature` at the pixel of `position`: eq. 4, mm, in -5000..=5000, or what follows.
    pub fn value(&self, feature: usize, position: u32) -> i16 {
        let (minuend, subtrahend) = self.operands(feature);
        let at = position as usize;
        minuend[at] - subtrahend.map_or(0, |values| values[at])
    }

    /// Where the values of `feature` come from: at each position the element of the first slice minus
    /// that of the second, if there is a second. Both go on for [`LANES`] elements from any position.
    #[inline]
    pub fn operands(&self, feature: usize) -> (&[i16], Option<&[i16]>) {
        let image = self.image;
        if let Some(&[u, v]) = self.offsets.get(feature) {
            let values = &image.values;
            return (&values[u as usize..], Some(&values[v as usize..]));
        }
        let extra = feature - self.offsets.len();
        let alone = match (self.extra, extra) {
            (Extra::Context, _) => &image.context[self.offsets[extra][0] as usize..],
            (_, 0) => &self.columns,
            (_, 1) => &self.rows,
            _ => &image.values[image.corner()..],
        };
        (alone, None)
    }
}

/// The values of all features at all samples, column-major: the values of one feature lie together,
/// and in them those of one image. Where a column comes from is the business of who fills it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SampleMatrix {
    samples: usize,
    values: Vec<i16>,
}

impl SampleMatrix {
    /// A matrix of `columns` features, filled image by image and in parallel. Image i has
    /// `counts[i]` samples, which follow those of image i - 1; `fill(i, runs)` writes its values of
    /// column f into `runs[f]`. Of several errors any one is returned.
    pub fn fill<E: Send>(
        columns: usize,
        counts: &[usize],
        fill: impl Fn(usize, &mut [&mut [i16]]) -> Result<(), E> + Sync,
    ) -> Result<Self, E> {
        let samples: usize = counts.iter().sum();
        let mut values = vec![0; columns * samples];
        let mut runs: Vec<Vec<&mut [i16]>> =
            counts.iter().map(|_| Vec::with_capacity(columns)).collect();
        for mut column in values.chunks_exact_mut(samples.max(1)) {
            for (image, &count) in runs.iter_mut().zip(counts) {
                let (run, rest) = column.split_at_mut(count);
                image.push(run);
                column = rest;
            }
        }
        runs.par_iter_mut()
            .enumerate()
            .try_for_each(|(image, runs)| fill(image, runs))?;
        Ok(Self { samples, values })
    }

    /// Values of a column.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// The columns in order, each with one value a sample.
    pub fn columns(&self) -> impl ExactSizeIterator<Item = &[i16]> {
        self.values.chunks_exact(self.samples.max(1))
    }
}
