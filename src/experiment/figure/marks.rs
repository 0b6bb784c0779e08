//! Draws the marks of a plot inside its frame.

use super::axes::Scale;
use super::canvas::{Canvas, Drawn, Point, text_width};
use super::draw::{Area, RIGHT, TICK, colour};
use super::{Mark, Picture, Plot, Shape};
use plotters::prelude::DrawingBackend;
use plotters::style::RGBAColor;

/// The place of the data inside a cell, and what maps values to it.
pub struct Frame {
    pub area: Area,
    pub x: Scale,
    pub y: Scale,
}

impl Frame {
    pub fn x(&self, value: f64) -> Option<f64> {
        Some(self.area.left + self.x.share(value)? * self.area.width())
    }

    pub fn y(&self, value: f64) -> Option<f64> {
        Some(self.area.bottom - self.y.share(value)? * self.area.height())
    }

    fn at(&self, (x, y): Point) -> Option<Point> {
        Some((self.x(x)?, self.y(y)?))
    }
}

pub fn draw<DB: DrawingBackend>(
    mark: &Mark,
    plot: &Plot,
    frame: &Frame,
    canvas: &Canvas<DB>,
) -> Drawn {
    let solid = colour(mark.colour, 1.0);
    let places =
        |points: &[Point]| -> Vec<Point> { points.iter().filter_map(|&p| frame.at(p)).collect() };
    match &mark.shape {
        Shape::Line(points) => {
            let places = places(points);
            canvas.line(&places, solid, 3.0)?;
            places.iter().try_for_each(|&p| canvas.dot(p, 5.0, solid))
        }
        Shape::Dashed(points) => canvas.dashed(&places(points), solid, 3.0),
        Shape::Scatter(points) => {
            let faint = colour(mark.colour, 0.6);
            places(points)
                .iter()
                .try_for_each(|&p| canvas.dot(p, 4.0, faint))
        }
        Shape::Band(points) => {
            let side = |of: fn(&(f64, f64, f64)) -> f64| -> Vec<Point> {
                points
                    .iter()
                    .filter_map(|p| frame.at((p.0, of(p))))
                    .collect()
            };
            let (low, high) = (side(|p| p.1), side(|p| p.2));
            let round: Vec<Point> = low.into_iter().chain(high.into_iter().rev()).collect();
            canvas.polygon(&round, colour(mark.colour, 0.2))
        }
        Shape::Errors(points) => points.iter().try_for_each(|&(x, low, high)| {
            match (frame.at((x, high)), frame.y(low)) {
                (Some(top), Some(bottom)) => error_bar(top, bottom, solid, canvas),
                _ => Ok(()),
            }
        }),
        Shape::Bars(bars) => bars_of(mark, bars, plot, frame, canvas),
        Shape::Histogram { edges, heights } => {
            let bottom = frame.y(0.0).unwrap_or(frame.area.bottom);
            for (edge, height) in edges.windows(2).zip(heights) {
                let (from, to) = (frame.at((edge[0], *height)), frame.x(edge[1]));
                if let (Some(from), Some(to)) = (from, to) {
                    canvas.rectangle(from, (to, bottom), colour(mark.colour, 0.55))?;
                    canvas.frame(from, (to, bottom), solid)?;
                }
            }
            Ok(())
        }
        Shape::Level(value) => {
            let Some(y) = frame.y(*value) else {
                return Ok(());
            };
            canvas.dashed(&[(frame.area.left, y), (frame.area.right, y)], solid, 2.0)?;
            let right = frame.area.right - 8.0;
            // Above the line, or below it when it lies at the very top.
            let side = if y - 1.4 * TICK < frame.area.top {
                0.75
            } else {
                -0.75
            };
            let middle = y + side * TICK;
            let from = (
                right - text_width(&mark.label, TICK) - 6.0,
                middle - 0.5 * TICK,
            );
            canvas.rectangle(
                from,
                (right + 4.0, middle + 0.5 * TICK),
                RGBAColor(255, 255, 255, 0.8),
            )?;
            canvas.text(&mark.label, (right, middle), TICK, RIGHT, false)
        }
        Shape::Areas(areas) => areas.iter().try_for_each(|area| {
            let mut corners = places(area);
            canvas.polygon(&corners, colour(mark.colour, 0.25))?;
            corners.extend(corners.first().copied());
            canvas.line(&corners, colour(mark.colour, 0.7), 1.0)
        }),
        Shape::Pictures(pictures) => draw_pictures(pictures, solid, frame, canvas),
    }
}

fn draw_pictures<DB: DrawingBackend>(
    pictures: &[(Point, Picture)],
    solid: RGBAColor,
    frame: &Frame,
    canvas: &Canvas<DB>,
) -> Drawn {
    const GAP: f64 = 3.0;
    let mut taken: Vec<Area> = Vec::new();
    let mut dots = Vec::new();
    for (point, picture) in pictures {
        let Some((x, y)) = frame.at(*point) else {
            continue;
        };
        let rows = picture.pixels.len() / picture.width.max(1);
        let (width, height) = (picture.width / 2, rows / 2);
        let (left, top) = (
            (x - width as f64 / 2.0).round(),
            (y - height as f64 / 2.0).round(),
        );
        let place = Area {
            left,
            top,
            right: left + width as f64,
            bottom: top + height as f64,
        };
        let is_inside = place.left > frame.area.left
            && place.right < frame.area.right
            && place.top > frame.area.top
            && place.bottom < frame.area.bottom;
        let is_covered = |other: &Area| {
            place.left < other.right + GAP
                && other.left < place.right + GAP
                && place.top < other.bottom + GAP
                && other.top < place.bottom + GAP
        };
        if !is_inside || taken.iter().any(is_covered) {
            dots.push((x, y));
            continue;
        }
        canvas.picture((left, top), (width, height), |across, down| {
            let column = (across * picture.width as f64) as usize;
            let row = (down * rows as f64) as usize;
            picture.pixels[row * picture.width + column]
        })?;
        taken.push(place);
    }
    // On top, so that none is hidden.
    for dot in dots {
        canvas.dot(dot, 5.0, RGBAColor(255, 255, 255, 1.0))?;
        canvas.dot(dot, 3.5, solid)?;
    }
    Ok(())
}

/// The bars of one mark stand side by side with those of the plot's other marks.
fn bars_of<DB: DrawingBackend>(
    mark: &Mark,
    bars: &[(f64, Option<(f64, f64)>)],
    plot: &Plot,
    frame: &Frame,
    canvas: &Canvas<DB>,
) -> Drawn {
    const GROUP: f64 = 0.8;
    let all = plot
        .marks
        .iter()
        .filter(|m| matches!(m.shape, Shape::Bars(_)));
    let count = all.clone().count() as f64;
    let rank = all.take_while(|m| !std::ptr::eq(*m, mark)).count() as f64;
    let bottom = frame.y(0.0).unwrap_or(frame.area.bottom);
    for (position, (value, error)) in bars.iter().enumerate() {
        let start = position as f64 - GROUP / 2.0 + GROUP * rank / count;
        let end = start + 0.94 * GROUP / count;
        let (Some(from), Some(right)) = (frame.at((start, *value)), frame.x(end)) else {
            continue;
        };
        canvas.rectangle(from, (right, bottom), colour(mark.colour, 1.0))?;
        let Some((low, high)) = error else { continue };
        if let (Some(top), Some(bottom)) = (frame.at(((start + end) / 2.0, *high)), frame.y(*low)) {
            error_bar(top, bottom, RGBAColor(30, 30, 30, 1.0), canvas)?;
        }
    }
    Ok(())
}

pub fn error_bar<DB: DrawingBackend>(
    top: Point,
    bottom: f64,
    colour: RGBAColor,
    canvas: &Canvas<DB>,
) -> Drawn {
    const CAP: f64 = 6.0;
    let (x, top) = top;
    canvas.line(&[(x, top), (x, bottom)], colour, 2.0)?;
    canvas.line(&[(x - CAP, top), (x + CAP, top)], colour, 2.0)?;
    canvas.line(&[(x - CAP, bottom), (x + CAP, bottom)], colour, 2.0)
}
