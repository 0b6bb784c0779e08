//! The legend: what stands for what, below all panels.

use super::canvas::{Canvas, Drawn, Point, text_width};
use super::draw::{Area, LEFT, TICK, colour};
use super::marks::error_bar;
use super::{Figure, Mark, Panel, Shape};
use plotters::prelude::DrawingBackend;

/// One legend for all panels, in rows at the bottom of `area`, which shrinks. A label that several
/// marks share stands there once, with the keys of those in the first panel on top of each other.
pub fn draw<DB: DrawingBackend>(figure: &Figure, canvas: &Canvas<DB>, area: &mut Area) -> Drawn {
    const KEY: f64 = 44.0;
    const GAP: f64 = 30.0;
    let mut entries: Vec<(&str, Vec<&Mark>)> = Vec::new();
    for panel in &figure.panels {
        let Panel::Plot(plot) = panel else { continue };
        let known = entries.len();
        for mark in &plot.marks {
            if mark.label.is_empty() || matches!(mark.shape, Shape::Level(_)) {
                continue;
            }
            match entries.iter().position(|(label, _)| *label == mark.label) {
                Some(position) if position < known => {} // an earlier panel's
                Some(position) => entries[position].1.push(mark),
                None => entries.push((&mark.label, vec![mark])),
            }
        }
    }
    let width_of = |label: &str| KEY + 10.0 + text_width(label, TICK) + GAP;
    let mut rows: Vec<Vec<&(&str, Vec<&Mark>)>> = Vec::new();
    let mut used = f64::INFINITY;
    for entry in &entries {
        let width = width_of(entry.0);
        if used + width > area.width() + GAP {
            rows.push(Vec::new());
            used = 0.0;
        }
        used += width;
        if let Some(row) = rows.last_mut() {
            row.push(entry);
        }
    }
    for row in rows.iter().rev() {
        let y = area.bottom - TICK / 2.0;
        let total: f64 = row.iter().map(|(label, _)| width_of(label)).sum::<f64>() - GAP;
        let mut x = (area.left + area.right - total) / 2.0;
        for (label, marks) in row {
            for mark in marks {
                key(mark, (x, y), KEY, canvas)?;
            }
            canvas.text(label, (x + KEY + 10.0, y), TICK, LEFT, false)?;
            x += width_of(label);
        }
        area.bottom -= 1.35 * TICK;
    }
    if !rows.is_empty() {
        area.bottom -= 6.0;
    }
    Ok(())
}

fn key<DB: DrawingBackend>(mark: &Mark, (x, y): Point, width: f64, canvas: &Canvas<DB>) -> Drawn {
    let solid = colour(mark.colour, 1.0);
    let middle = x + width / 2.0;
    match mark.shape {
        Shape::Line(_) => {
            canvas.line(&[(x, y), (x + width, y)], solid, 3.0)?;
            canvas.dot((middle, y), 5.0, solid)
        }
        Shape::Dashed(_) => canvas.dashed(&[(x, y), (x + width, y)], solid, 3.0),
        Shape::Band(_) => {
            canvas.rectangle((x, y - 9.0), (x + width, y + 9.0), colour(mark.colour, 0.2))
        }
        Shape::Errors(_) => error_bar((middle, y - 10.0), y + 10.0, solid, canvas),
        Shape::Scatter(_) => canvas.dot((middle, y), 5.0, solid),
        Shape::Pictures(_) => canvas.dot((middle, y), 3.5, solid),
        Shape::Areas(_) => {
            let (from, to) = ((x + 8.0, y - 9.0), (x + width - 8.0, y + 9.0));
            canvas.rectangle(from, to, colour(mark.colour, 0.25))?;
            canvas.frame(from, to, colour(mark.colour, 0.7))
        }
        Shape::Bars(_) | Shape::Histogram { .. } => {
            canvas.rectangle((x + 8.0, y - 9.0), (x + width - 8.0, y + 9.0), solid)
        }
        Shape::Level(_) => Ok(()),
    }
}
