//! Draws a figure: title, panels, legend, caption.

use super::axes::{Scale, Tick, scales};
use super::canvas::{Canvas, Drawn, HPos, Point, VPos, text_width};
use super::{Axis, DepthPanel, Figure, Mark, PALETTE, Panel, Plot, Shape, viridis};
use plotters::prelude::DrawingBackend;
use plotters::style::RGBAColor;

const MARGIN: f64 = 24.0;
const TITLE: f64 = 34.0;
const PANEL_TITLE: f64 = 27.0;
const LABEL: f64 = 25.0;
const TICK: f64 = 22.0;
const CAPTION: f64 = 22.0;
/// From one line of text to the next, in units of its size.
const LEADING: f64 = 1.25;
const AXIS: RGBAColor = RGBAColor(90, 90, 90, 1.0);
const GRID: RGBAColor = RGBAColor(225, 225, 225, 1.0);
const CENTRE: (HPos, VPos) = (HPos::Center, VPos::Center);
const LEFT: (HPos, VPos) = (HPos::Left, VPos::Center);
const RIGHT: (HPos, VPos) = (HPos::Right, VPos::Center);

/// A rectangle of the figure, in pixels.
#[derive(Clone, Copy)]
struct Area {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Area {
    fn width(&self) -> f64 {
        self.right - self.left
    }

    fn height(&self) -> f64 {
        self.bottom - self.top
    }
}

pub fn draw<DB: DrawingBackend>(figure: &Figure, canvas: &Canvas<DB>) -> Drawn {
    let mut area = Area {
        left: MARGIN,
        top: MARGIN,
        right: f64::from(figure.size.0) - MARGIN,
        bottom: f64::from(figure.size.1) - MARGIN,
    };
    let middle = (area.left + area.right) / 2.0;
    for line in wrap(&figure.title, TITLE, area.width()) {
        canvas.text(
            &line,
            (middle, area.top + TITLE / 2.0),
            TITLE,
            CENTRE,
            false,
        )?;
        area.top += LEADING * TITLE;
    }
    for line in wrap(&figure.caption, CAPTION, area.width()).iter().rev() {
        canvas.text(
            line,
            (middle, area.bottom - CAPTION / 2.0),
            CAPTION,
            CENTRE,
            false,
        )?;
        area.bottom -= LEADING * CAPTION;
    }
    area.bottom -= 8.0;
    legend(figure, canvas, &mut area)?;

    let columns = figure.columns.clamp(1, figure.panels.len().max(1));
    let rows = figure.panels.len().div_ceil(columns);
    let (width, height) = (area.width() / columns as f64, area.height() / rows as f64);
    for (index, panel) in figure.panels.iter().enumerate() {
        let left = area.left + width * (index % columns) as f64;
        let top = area.top + height * (index / columns) as f64;
        let cell = Area {
            left,
            top,
            right: left + width,
            bottom: top + height,
        };
        match panel {
            Panel::Plot(plot) => draw_plot(plot, cell, canvas)?,
            Panel::Depth(depth) => draw_depth(depth, cell, canvas)?,
        }
    }
    Ok(())
}

/// Breaks text into lines of at most `width` pixels, at spaces.
fn wrap(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

fn colour(index: usize, alpha: f64) -> RGBAColor {
    let (r, g, b) = PALETTE[index % PALETTE.len()];
    RGBAColor(r, g, b, alpha)
}

/// One legend for all panels, in rows at the bottom of `area`, which shrinks. A label that several
/// marks share stands there once, with the keys of those in the first panel on top of each other.
fn legend<DB: DrawingBackend>(figure: &Figure, canvas: &Canvas<DB>, area: &mut Area) -> Drawn {
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
                legend_key(mark, (x, y), KEY, canvas)?;
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

fn legend_key<DB: DrawingBackend>(
    mark: &Mark,
    (x, y): Point,
    width: f64,
    canvas: &Canvas<DB>,
) -> Drawn {
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
        Shape::Bars(_) | Shape::Histogram { .. } => {
            canvas.rectangle((x + 8.0, y - 9.0), (x + width - 8.0, y + 9.0), solid)
        }
        Shape::Level(_) => Ok(()),
    }
}

/// The place of the data inside a cell, and what maps values to it.
struct Frame {
    area: Area,
    x: Scale,
    y: Scale,
}

impl Frame {
    fn x(&self, value: f64) -> Option<f64> {
        Some(self.area.left + self.x.share(value)? * self.area.width())
    }

    fn y(&self, value: f64) -> Option<f64> {
        Some(self.area.bottom - self.y.share(value)? * self.area.height())
    }

    fn at(&self, (x, y): Point) -> Option<Point> {
        Some((self.x(x)?, self.y(y)?))
    }
}

fn draw_plot<DB: DrawingBackend>(plot: &Plot, cell: Area, canvas: &Canvas<DB>) -> Drawn {
    let (x, y) = scales(&plot.x, &plot.y, &plot.marks);
    let y_ticks = named_ticks(&plot.y, &y, (cell.height() / 75.0) as usize);
    let x_ticks = named_ticks(&plot.x, &x, (cell.width() / 110.0) as usize);
    let widest = |ticks: &[Tick]| {
        let labels = ticks.iter().filter_map(|t| t.label.as_deref());
        labels.map(|l| text_width(l, TICK)).fold(0.0, f64::max)
    };
    let left = cell.left + 1.5 * LABEL + widest(&y_ticks) + 14.0;
    let right = cell.right - 22.0;
    let slot = (right - left) / plot.x.categories.len().max(1) as f64;
    let is_upright = !plot.x.categories.is_empty() && widest(&x_ticks) + 8.0 > slot;
    let tick_height = if is_upright { widest(&x_ticks) } else { TICK };
    let frame = Frame {
        area: Area {
            left,
            right,
            top: cell.top
                + if plot.title.is_empty() {
                    12.0
                } else {
                    1.6 * PANEL_TITLE
                },
            bottom: cell.bottom - 1.7 * LABEL - tick_height - 8.0,
        },
        x,
        y,
    };
    let area = frame.area;
    let middle = (area.left + area.right) / 2.0;
    canvas.text(
        &plot.title,
        (middle, cell.top + 0.7 * PANEL_TITLE),
        PANEL_TITLE,
        CENTRE,
        false,
    )?;

    for tick in &y_ticks {
        let Some(at) = frame.y(tick.value) else {
            continue;
        };
        canvas.line(&[(area.left, at), (area.right, at)], GRID, 1.0)?;
        if let Some(label) = &tick.label {
            canvas.line(&[(area.left - 6.0, at), (area.left, at)], AXIS, 1.0)?;
            canvas.text(label, (area.left - 10.0, at), TICK, RIGHT, false)?;
        }
    }
    for tick in &x_ticks {
        let Some(at) = frame.x(tick.value) else {
            continue;
        };
        if plot.x.categories.is_empty() {
            canvas.line(&[(at, area.top), (at, area.bottom)], GRID, 1.0)?;
        }
        if let Some(label) = &tick.label {
            canvas.line(&[(at, area.bottom), (at, area.bottom + 6.0)], AXIS, 1.0)?;
            let below = area.bottom + 8.0 + tick_height / 2.0;
            canvas.text(label, (at, below), TICK, CENTRE, is_upright)?;
        }
    }
    for mark in &plot.marks {
        draw_mark(mark, plot, &frame, canvas)?;
    }
    canvas.frame((area.left, area.top), (area.right, area.bottom), AXIS)?;
    canvas.text(
        &plot.x.label,
        (middle, cell.bottom - 0.9 * LABEL),
        LABEL,
        CENTRE,
        false,
    )?;
    let beside = (cell.left + 0.6 * LABEL, (area.top + area.bottom) / 2.0);
    canvas.text(&plot.y.label, beside, LABEL, CENTRE, true)
}

fn named_ticks(axis: &Axis, scale: &Scale, count: usize) -> Vec<Tick> {
    if axis.categories.is_empty() {
        return scale.ticks(count.max(3));
    }
    let names = axis.categories.iter().enumerate();
    names
        .map(|(position, name)| Tick {
            value: position as f64,
            label: Some(name.clone()),
        })
        .collect()
}

fn draw_mark<DB: DrawingBackend>(
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
        Shape::Bars(bars) => draw_bars(mark, bars, plot, frame, canvas),
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
    }
}

/// The bars of one mark stand side by side with those of the plot's other marks.
fn draw_bars<DB: DrawingBackend>(
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

fn error_bar<DB: DrawingBackend>(
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

fn draw_depth<DB: DrawingBackend>(panel: &DepthPanel, cell: Area, canvas: &Canvas<DB>) -> Drawn {
    const BAR: f64 = 16.0;
    let (near, far) = panel.range_mm;
    let metres = |mm: u16| format!("{} m", f64::from(mm) / 1000.0);
    let scale_width =
        BAR + 24.0 + text_width(&metres(near), TICK).max(text_width(&metres(far), TICK));
    let top = cell.top
        + if panel.title.is_empty() {
            8.0
        } else {
            1.6 * PANEL_TITLE
        };
    let image = &panel.image;
    let zoom = ((cell.width() - scale_width - 16.0) / image.width as f64)
        .min((cell.bottom - top - 12.0) / image.height as f64);
    let size = |n: usize| ((n as f64 * zoom) as usize).max(1);
    let (width, height) = (size(image.width), size(image.height));
    let left = (cell.left + cell.right - width as f64 - scale_width) / 2.0;
    let title_at = (left + width as f64 / 2.0, cell.top + 0.7 * PANEL_TITLE);
    canvas.text(&panel.title, title_at, PANEL_TITLE, CENTRE, false)?;

    let pixel = |across: f64, down: f64| {
        let column = (across * image.width as f64) as usize;
        let row = (down * image.height as f64) as usize;
        match image.pixels.get(row * image.width + column) {
            None | Some(0) => [0, 0, 0],
            Some(&mm) => {
                let range = f64::from(far) - f64::from(near);
                viridis((f64::from(far) - f64::from(mm)) / range)
            }
        }
    };
    canvas.picture((left, top), (width, height), pixel)?;
    let bar = left + width as f64 + 12.0;
    canvas.picture((bar, top), (BAR as usize, height), |_, down| {
        viridis(1.0 - down)
    })?;
    let beside = bar + BAR + 8.0;
    let bottom = top + height as f64;
    canvas.text(&metres(near), (beside, top + TICK / 2.0), TICK, LEFT, false)?;
    canvas.text(
        &metres(far),
        (beside, bottom - TICK / 2.0),
        TICK,
        LEFT,
        false,
    )
}
