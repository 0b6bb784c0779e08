//! Figures as plain data: panels that hold marks on axes, or depth images. [`Figure::svg`] and
//! [`Figure::png`] draw the same picture.

use crate::camera::DepthImage;

/// Panels in rows below a title and above a caption.
#[derive(Debug, Clone)]
pub struct Figure {
    pub title: String,
    /// One line below the panels. It says what bands and bars mean.
    pub caption: String,
    pub panels: Vec<Panel>,
    /// How many panels stand side by side.
    pub columns: usize,
    /// Width and height in pixels (the SVG's units); text is of fixed size.
    pub size: (u32, u32),
}

#[derive(Debug, Clone)]
pub enum Panel {
    Plot(Plot),
    Depth(DepthPanel),
}

/// A depth image in false colours (viridis, near is bright), invalid pixels black.
#[derive(Debug, Clone)]
pub struct DepthPanel {
    pub title: String,
    pub image: DepthImage,
    /// Nearest and farthest depth of the colour scale, millimetres.
    pub range_mm: (u16, u16),
}

/// Marks on a pair of axes. The legend stands outside, to the right, when any mark has a label.
#[derive(Debug, Clone)]
pub struct Plot {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    /// Drawn in this order.
    pub marks: Vec<Mark>,
}

/// An axis. The label carries the unit: "error (deg)".
#[derive(Debug, Clone, Default)]
pub struct Axis {
    pub label: String,
    pub log: bool,
    /// What must be visible at least, for example (0, 0) to begin at zero.
    pub include: Option<(f64, f64)>,
    /// Names at the positions 0, 1, 2, ... instead of numbers.
    pub categories: Vec<String>,
}

impl Axis {
    pub fn new(label: &str) -> Axis {
        Axis {
            label: label.to_owned(),
            ..Axis::default()
        }
    }

    pub fn log(self) -> Axis {
        Axis { log: true, ..self }
    }

    /// Extends the axis so that `low` and `high` are on it.
    pub fn including(self, low: f64, high: f64) -> Axis {
        Axis {
            include: Some((low, high)),
            ..self
        }
    }

    /// An axis of names for [`Shape::Bars`].
    pub fn of<S: Into<String>>(label: &str, categories: impl IntoIterator<Item = S>) -> Axis {
        Axis {
            categories: categories.into_iter().map(S::into).collect(),
            ..Axis::new(label)
        }
    }
}

/// Something drawn in one colour. Marks with the same label share one line of the legend.
#[derive(Debug, Clone)]
pub struct Mark {
    /// In the legend; empty for none.
    pub label: String,
    /// An index into the colour-blind-safe [`PALETTE`], taken modulo its length.
    pub colour: usize,
    pub shape: Shape,
}

/// Positions are in the units of the axes. Values that are not finite are left out.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A line through points, each with a marker. Points ascend in x.
    Line(Vec<(f64, f64)>),
    /// A dashed line without markers.
    Dashed(Vec<(f64, f64)>),
    /// A shaded band: x, low, high.
    Band(Vec<(f64, f64, f64)>),
    /// Vertical error bars: x, low, high.
    Errors(Vec<(f64, f64, f64)>),
    Scatter(Vec<(f64, f64)>),
    /// One bar for each category, beside those of the other marks; low and high of an error bar.
    Bars(Vec<(f64, Option<(f64, f64)>)>),
    /// Heights over bins: `edges` is one longer than `heights`.
    Histogram {
        edges: Vec<f64>,
        heights: Vec<f64>,
    },
    /// A horizontal line over the whole width, named in place: a floor or ceiling.
    Level(f64),
}

impl Mark {
    pub fn new(label: &str, colour: usize, shape: Shape) -> Mark {
        Mark {
            label: label.to_owned(),
            colour,
            shape,
        }
    }
}

/// Okabe and Ito's palette, which people with any kind of colour vision tell apart; black is last.
pub const PALETTE: [(u8, u8, u8); 8] = [
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
    (240, 228, 66),
    (0, 0, 0),
];
