//! A thin layer over plotters: shapes and text in figure pixels, the same on SVG and bitmaps.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::Pos;
pub use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{FontDesc, FontTransform, register_font};
use std::sync::OnceLock;

/// Also a list for viewers of the SVG: the first that they have is taken.
const FONT: &str = "DejaVu Sans, sans-serif";

/// A figure that could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw the figure: {0}")]
pub struct FigureError(String);

impl FigureError {
    pub fn new(error: impl std::fmt::Display) -> FigureError {
        FigureError(error.to_string())
    }
}

pub type Drawn = Result<(), FigureError>;

/// Where one draws. Coordinates are figure pixels from the top left; a bitmap has `scale` of its
/// own pixels for each, so that it can be brought down smoothly.
pub struct Canvas<DB: DrawingBackend> {
    area: DrawingArea<DB, Shift>,
    scale: f64,
}

pub type Point = (f64, f64);

impl<DB: DrawingBackend> Canvas<DB> {
    pub fn new(backend: DB, scale: f64) -> Result<Canvas<DB>, FigureError> {
        static FONT_IS_USABLE: OnceLock<bool> = OnceLock::new();
        let register = || {
            let bytes = include_bytes!("../../../data/fonts/DejaVuSans.ttf");
            register_font(FONT, FontStyle::Normal, bytes).is_ok()
        };
        if !*FONT_IS_USABLE.get_or_init(register) {
            return Err(FigureError::new("the font is unreadable"));
        }
        let area = backend.into_drawing_area();
        area.fill(&WHITE).map_err(FigureError::new)?;
        Ok(Canvas { area, scale })
    }

    pub fn finish(self) -> Drawn {
        self.area.present().map_err(FigureError::new)
    }

    fn at(&self, (x, y): Point) -> (i32, i32) {
        (
            (x * self.scale).round() as i32,
            (y * self.scale).round() as i32,
        )
    }

    fn draw<E>(&self, element: E) -> Drawn
    where
        for<'b> &'b E: plotters::element::PointCollection<'b, (i32, i32)>,
        E: plotters::element::Drawable<DB>,
    {
        self.area.draw(&element).map_err(FigureError::new)
    }

    pub fn line(&self, points: &[Point], colour: RGBAColor, width: f64) -> Drawn {
        let points: Vec<_> = points.iter().map(|&p| self.at(p)).collect();
        self.draw(PathElement::new(
            points,
            colour.stroke_width((width * self.scale) as u32),
        ))
    }

    /// Dashes of 10 with gaps of 6 pixels.
    pub fn dashed(&self, points: &[Point], colour: RGBAColor, width: f64) -> Drawn {
        let (dash, period) = (10.0, 16.0);
        let mut travelled = 0.0;
        for ends in points.windows(2) {
            let ((x0, y0), (x1, y1)) = (ends[0], ends[1]);
            let length = (x1 - x0).hypot(y1 - y0);
            let along = |s: f64| (x0 + (x1 - x0) * s / length, y0 + (y1 - y0) * s / length);
            let mut start = -(travelled % period);
            while start < length {
                let (from, to) = (start.max(0.0), (start + dash).min(length));
                if from < to {
                    self.line(&[along(from), along(to)], colour, width)?;
                }
                start += period;
            }
            travelled += length;
        }
        Ok(())
    }

    pub fn rectangle(&self, from: Point, to: Point, colour: RGBAColor) -> Drawn {
        self.draw(Rectangle::new(
            [self.at(from), self.at(to)],
            colour.filled(),
        ))
    }

    pub fn frame(&self, from: Point, to: Point, colour: RGBAColor) -> Drawn {
        let (left, top, right, bottom) = (from.0, from.1, to.0, to.1);
        let round = [
            (left, top),
            (right, top),
            (right, bottom),
            (left, bottom),
            (left, top),
        ];
        self.line(&round, colour, 1.0)
    }

    pub fn polygon(&self, points: &[Point], colour: RGBAColor) -> Drawn {
        let points: Vec<_> = points.iter().map(|&p| self.at(p)).collect();
        self.draw(Polygon::new(points, colour.filled()))
    }

    pub fn dot(&self, centre: Point, radius: f64, colour: RGBAColor) -> Drawn {
        let radius = (radius * self.scale).round() as i32;
        self.draw(Circle::new(self.at(centre), radius, colour.filled()))
    }

    /// Text with its anchor at `at`; `upwards` turns it a quarter to the left.
    pub fn text(
        &self,
        text: &str,
        at: Point,
        size: f64,
        anchor: (HPos, VPos),
        upwards: bool,
    ) -> Drawn {
        let transform = match upwards {
            true => FontTransform::Rotate270,
            false => FontTransform::None,
        };
        let style = TextStyle::from(font(size * self.scale).transform(transform))
            .color(&RGBColor(30, 30, 30))
            .pos(Pos::new(anchor.0, anchor.1));
        self.draw(Text::new(text.to_owned(), self.at(at), style))
    }

    /// RGB pixels, row by row, as `width` times `height` figure pixels.
    pub fn picture(
        &self,
        at: Point,
        (width, height): (usize, usize),
        pixel: impl Fn(f64, f64) -> [u8; 3],
    ) -> Drawn {
        let of = |n: usize| (n as f64 * self.scale).round() as usize;
        let (width, height) = (of(width), of(height));
        let share = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
        let bytes: Vec<u8> = (0..width * height)
            .flat_map(|i| pixel(share(i % width, width), share(i / width, height)))
            .collect();
        let size = (width as u32, height as u32);
        let element = BitMapElement::<_>::with_owned_buffer(self.at(at), size, bytes);
        self.draw(element.ok_or_else(|| FigureError::new("a picture without pixels"))?)
    }
}

fn font(size: f64) -> FontDesc<'static> {
    FontDesc::new(FontFamily::Name(FONT), size, FontStyle::Normal)
}

/// Figure pixels that `text` takes. Measured at a large size, so that it does not depend on hinting.
pub fn text_width(text: &str, size: f64) -> f64 {
    let measured = font(100.0).layout_box(text);
    measured.map_or(0.0, |((left, _), (right, _))| {
        f64::from(right - left) * size / 100.0
    })
}
