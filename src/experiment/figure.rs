//! Figures as plain data: panels that hold marks on axes, depth images, or pictures. [`Figure::svg`] and
//! [`Figure::png`] draw the same picture.

mod axes;
mod canvas;
mod draw;
mod legend;
mod marks;

use crate::camera::{DepthImage, Image};
use canvas::Canvas;
pub use canvas::FigureError;
use plotters::prelude::{BitMapBackend, SVGBackend};

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
    Picture(PicturePanel),
}

/// An image in its own colours.
#[derive(Debug, Clone)]
pub struct PicturePanel {
    pub title: String,
    /// Red, green, blue.
    pub image: Image<[u8; 3]>,
}

/// A depth image in false colours (viridis, near is bright), invalid pixels black.
#[derive(Debug, Clone)]
pub struct DepthPanel {
    pub title: String,
    pub image: DepthImage,
    /// Nearest and farthest depth of the colour scale, millimetres.
    pub range_mm: (u16, u16),
}

/// Marks on a pair of axes. The figure has one legend below all panels.
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
    /// One unit is as long here as on the other axis.
    pub to_scale: bool,
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

    /// Makes one unit as long as on the other axis.
    pub fn to_scale(self) -> Axis {
        Axis {
            to_scale: true,
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
    /// Filled polygons with an outline.
    Areas(Vec<Vec<(f64, f64)>>),
    /// Pictures with their centres at points. One that would lie on an earlier one, or across the
    /// edge of the plot, is left out for a dot.
    Pictures(Vec<((f64, f64), Picture)>),
}

/// Rows of pixels, two of them to each pixel of the figure across and down.
#[derive(Debug, Clone)]
pub struct Picture {
    pub width: usize,
    pub pixels: Vec<[u8; 3]>,
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

/// A bitmap is drawn this much larger and averaged, so that edges are smooth.
const OVERSAMPLING: usize = 2;

impl Figure {
    /// Whether no panel has axes.
    pub fn is_of_images(&self) -> bool {
        let is_plot = |panel: &Panel| matches!(panel, Panel::Plot(_));
        !self.panels.iter().any(is_plot)
    }

    /// An SVG document.
    pub fn svg(&self) -> Result<String, FigureError> {
        let mut text = String::new();
        let canvas = Canvas::new(SVGBackend::with_string(&mut text, self.size), 1.0)?;
        draw::draw(self, &canvas)?;
        canvas.finish()?;
        // plotters embeds pictures under a media type that is none.
        Ok(text.replace("data:png;base64,", "data:image/png;base64,"))
    }

    /// An 8-bit RGB PNG file.
    pub fn png(&self) -> Result<Vec<u8>, FigureError> {
        let (width, height) = (self.size.0 as usize, self.size.1 as usize);
        let row = width * OVERSAMPLING * 3;
        let mut large = vec![0; row * height * OVERSAMPLING];
        let size = (
            self.size.0 * OVERSAMPLING as u32,
            self.size.1 * OVERSAMPLING as u32,
        );
        let canvas = Canvas::new(
            BitMapBackend::with_buffer(&mut large, size),
            OVERSAMPLING as f64,
        )?;
        draw::draw(self, &canvas)?;
        canvas.finish()?;

        let mut small = Vec::with_capacity(width * height * 3);
        for rows in large.chunks_exact(row * OVERSAMPLING) {
            for x in 0..width {
                for channel in 0..3 {
                    let samples = (0..OVERSAMPLING * OVERSAMPLING).map(|i| {
                        let (dx, dy) = (i % OVERSAMPLING, i / OVERSAMPLING);
                        u32::from(rows[dy * row + (x * OVERSAMPLING + dx) * 3 + channel])
                    });
                    small.push((samples.sum::<u32>() / (OVERSAMPLING * OVERSAMPLING) as u32) as u8);
                }
            }
        }
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, self.size.0, self.size.1);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(FigureError::new)?;
        writer.write_image_data(&small).map_err(FigureError::new)?;
        writer.finish().map_err(FigureError::new)?;
        Ok(file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure() -> Figure {
        let points: Vec<(f64, f64)> = (1..=10)
            .map(|i| (i as f64, 40.0 / f64::from(i).sqrt()))
            .collect();
        let band = points.iter().map(|&(x, y)| (x, y - 2.0, y + 2.0)).collect();
        let other: Vec<(f64, f64)> = points.iter().map(|&(x, y)| (x, 0.8 * y + 3.0)).collect();
        let errors = other.iter().map(|&(x, y)| (x, y - 1.5, y + 1.5)).collect();
        let curves = Plot {
            title: "Error over the number of trees".to_owned(),
            x: Axis::new("trees").log(),
            y: Axis::new("mean absolute error (deg)").including(0.0, 0.0),
            marks: vec![
                Mark::new("MSE", 0, Shape::Band(band)),
                Mark::new("MSE", 0, Shape::Line(points.clone())),
                Mark::new("WSC", 1, Shape::Errors(errors)),
                Mark::new("WSC", 1, Shape::Line(other)),
                Mark::new(
                    "",
                    2,
                    Shape::Dashed(points.iter().map(|p| (p.0, 5.0 + p.0)).collect()),
                ),
                Mark::new("constant mean pose", 7, Shape::Level(41.0)),
            ],
        };
        let joints = [
            "R_SFE", "R_SAA", "R_HR", "R_EB", "R_WR", "R_WFE", "R_WAA", "R_FR",
        ];
        let bars = |offset: f64| {
            let bar = |i: usize| {
                (
                    20.0 + offset + i as f64,
                    Some((18.0 + offset, 23.0 + offset + i as f64)),
                )
            };
            Shape::Bars((0..joints.len()).map(bar).collect())
        };
        let per_joint = Plot {
            title: "Error of each joint".to_owned(),
            x: Axis::of("joint", joints),
            y: Axis::new("mean absolute error (deg)"),
            marks: vec![
                Mark::new("MSE", 0, bars(0.0)),
                Mark::new("WSC", 1, bars(3.0)),
                Mark::new("MSPD", 2, bars(5.0)),
            ],
        };
        let scatter = Plot {
            title: "Visible arm pixels".to_owned(),
            x: Axis::new("visible pixels of the right arm").log(),
            y: Axis::new("error (deg)"),
            marks: vec![Mark::new(
                "an image",
                5,
                Shape::Scatter(
                    (1..150)
                        .map(|i| {
                            (
                                f64::from(i * i),
                                60.0 / f64::from(i).sqrt() + f64::from(i * 7 % 13),
                            )
                        })
                        .collect(),
                ),
            )],
        };
        let histogram = Plot {
            title: "Sampled angles of R_SFE".to_owned(),
            x: Axis::new("angle (rad)"),
            y: Axis::new("images"),
            marks: vec![Mark::new(
                "",
                4,
                Shape::Histogram {
                    edges: (0..=20).map(|i| -2.0 + f64::from(i) * 0.2).collect(),
                    heights: (0..20).map(|i| f64::from(10 + i * 7 % 5)).collect(),
                },
            )],
        };
        let depth = DepthPanel {
            title: "Depth".to_owned(),
            image: Image {
                width: 64,
                height: 48,
                pixels: (0..64 * 48)
                    .map(|i| {
                        if i % 64 < 8 {
                            0
                        } else {
                            500 + (i % 64) as u16 * 40
                        }
                    })
                    .collect(),
            },
            range_mm: (500, 3100),
        };
        let colours = PicturePanel {
            title: "Red to the right, blue downwards".to_owned(),
            image: Image {
                width: 20,
                height: 30,
                pixels: (0..600u32)
                    .map(|i| [(i % 20 * 12) as u8, 0, (i / 20 * 8) as u8])
                    .collect(),
            },
        };
        let long_names = Plot {
            title: String::new(),
            x: Axis::of(
                "",
                (0..6).map(|i| format!("a condition with a long name {i}")),
            ),
            y: Axis::new("y (mm)"),
            marks: vec![Mark::new(
                "",
                3,
                Shape::Bars((0..6).map(|i| (f64::from(i) - 2.0, None)).collect()),
            )],
        };
        let picture = |x: f64, y: f64, grey: u8| {
            let (width, pixels) = (80, vec![[grey; 3]; 80 * 60]);
            ((x, y), Picture { width, pixels })
        };
        // The second lies on the first and the last across the edge.
        let pictures = vec![
            picture(0.2, 0.5, 100),
            picture(0.22, 0.52, 150),
            picture(0.8, 0.5, 200),
            picture(0.5, 1.0, 50),
        ];
        let to_scale = Plot {
            title: "Pictures and areas, to scale".to_owned(),
            x: Axis::new("x (m)").including(0.0, 1.0).to_scale(),
            y: Axis::new("y (m)").including(0.0, 1.0),
            marks: vec![
                Mark::new(
                    "a square",
                    5,
                    Shape::Areas(vec![vec![(0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.4, 0.6)]]),
                ),
                Mark::new("no room", 1, Shape::Pictures(pictures)),
            ],
        };
        Figure {
            title: "Everything that a figure can hold".to_owned(),
            caption: "Bands and error bars are one standard deviation over 5 folds; the dashed line is the constant pose that a method must beat, and this caption is long enough to need two lines.".to_owned(),
            panels: vec![
                Panel::Plot(curves),
                Panel::Plot(per_joint),
                Panel::Plot(scatter),
                Panel::Plot(histogram),
                Panel::Depth(depth),
                Panel::Picture(colours),
                Panel::Plot(long_names),
                Panel::Plot(to_scale),
            ],
            columns: 3,
            size: (1800, 1700),
        }
    }

    #[test]
    fn figures_are_the_same_bits_every_time() {
        let figure = figure();
        let (svg, png) = (figure.svg().unwrap(), figure.png().unwrap());
        if let Some(folder) = std::env::var_os("ARMPOSE_LOOK") {
            std::fs::write(std::path::Path::new(&folder).join("figure.png"), &png).unwrap();
            std::fs::write(std::path::Path::new(&folder).join("figure.svg"), &svg).unwrap();
        }
        assert_eq!(svg, figure.svg().unwrap());
        assert_eq!(png, figure.png().unwrap());
        for text in [
            "Error of each joint",
            "constant mean pose",
            "R_WAA",
            "0.5 m",
            "data:image/png",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        // The depth image, its scale, the picture in colours, and two of four small ones.
        assert_eq!(svg.matches("data:image/png").count(), 5);
    }

    #[test]
    fn an_empty_figure_is_drawn() {
        let plot = Plot {
            title: String::new(),
            x: Axis::new("x").log(),
            y: Axis::new("y"),
            marks: vec![
                Mark::new("a", 0, Shape::Line(vec![(f64::NAN, 1.0)])),
                Mark::new("b", 0, Shape::Band(vec![])),
            ],
        };
        let figure = Figure {
            title: String::new(),
            caption: String::new(),
            panels: vec![Panel::Plot(plot)],
            columns: 1,
            size: (300, 200),
        };
        figure.svg().unwrap();
        figure.png().unwrap();
    }
}
