//! Draws a figure: title, panels with their axes, caption.

use super::axes::{Scale, Tick, scales};
use super::canvas::{Canvas, Drawn, FigureError, HPos, VPos, text_width};
use super::marks::Frame;
use super::{Axis, DepthPanel, Figure, PALETTE, Panel, PicturePanel, Plot, legend, marks};
use crate::camera::Image;
use crate::dataset::viridis;
use plotters::prelude::DrawingBackend;
use plotters::style::RGBAColor;

const MARGIN: f64 = 24.0;
const TITLE: f64 = 34.0;
const PANEL_TITLE: f64 = 27.0;
const LABEL: f64 = 25.0;
pub const TICK: f64 = 22.0;
const CAPTION: f64 = 22.0;
/// From one line of text to the next, in units of its size.
const LEADING: f64 = 1.25;
const AXIS: RGBAColor = RGBAColor(90, 90, 90, 1.0);
const GRID: RGBAColor = RGBAColor(225, 225, 225, 1.0);
pub const CENTRE: (HPos, VPos) = (HPos::Center, VPos::Center);
pub const LEFT: (HPos, VPos) = (HPos::Left, VPos::Center);
pub const RIGHT: (HPos, VPos) = (HPos::Right, VPos::Center);

/// A rectangle of the figure, in pixels.
#[derive(Clone, Copy)]
pub struct Area {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

impl Area {
    pub fn width(&self) -> f64 {
        self.right - self.left
    }

    pub fn height(&self) -> f64 {
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
    legend::draw(figure, canvas, &mut area)?;

    let columns = figure.columns.clamp(1, figure.panels.len().max(1));
    let rows = figure.panels.len().div_ceil(columns);
    let (width, height) = (area.width() / columns as f64, area.height() / rows as f64);
    // Beside depth images, pictures leave as much room, and so are of one size with them.
    let beside = figure.panels.iter().map(|panel| match panel {
        Panel::Depth(depth) => depth_scale_width(depth),
        Panel::Picture(_) | Panel::Plot(_) => 0.0,
    });
    let beside = beside.fold(0.0, f64::max);
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
            Panel::Depth(depth) => draw_depth(depth, cell, beside, canvas)?,
            Panel::Picture(PicturePanel { title, image }) => {
                draw_image(title, image, |&rgb| rgb, cell, beside, canvas)?;
            }
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

pub fn colour(index: usize, alpha: f64) -> RGBAColor {
    let (r, g, b) = PALETTE[index % PALETTE.len()];
    RGBAColor(r, g, b, alpha)
}

fn draw_plot<DB: DrawingBackend>(plot: &Plot, cell: Area, canvas: &Canvas<DB>) -> Drawn {
    let (x, y) = scales(&plot.x, &plot.y, &plot.marks);
    let ticks = |x: &Scale, y: &Scale| {
        let across = named_ticks(&plot.x, x, (cell.width() / 110.0) as usize);
        let up = named_ticks(&plot.y, y, (cell.height() / 75.0) as usize);
        (across, up)
    };
    let (mut x_ticks, mut y_ticks) = ticks(&x, &y);
    let widest = |ticks: &[Tick]| {
        let labels = ticks.iter().filter_map(|t| t.label.as_deref());
        labels.map(|l| text_width(l, TICK)).fold(0.0, f64::max)
    };
    let left = cell.left + 1.5 * LABEL + widest(&y_ticks) + 14.0;
    let right = cell.right - 22.0;
    // Names of categories are broken into lines, or stand upright where a word is too wide.
    let slot = (right - left) / plot.x.categories.len().max(1) as f64 - 8.0;
    let lines_of = |ticks: &[Tick]| -> Vec<Vec<String>> {
        let labels = ticks.iter().map(|tick| tick.label.as_deref());
        labels
            .map(|label| wrap(label.unwrap_or(""), TICK, slot))
            .collect()
    };
    let mut x_lines = lines_of(&x_ticks);
    let words = x_lines.iter().flatten();
    let is_upright =
        !plot.x.categories.is_empty() && words.clone().any(|line| text_width(line, TICK) > slot);
    let line_count = x_lines.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let tick_height = if is_upright {
        widest(&x_ticks)
    } else {
        LEADING * TICK * line_count
    };
    let x_label_height = if plot.x.label.is_empty() {
        12.0
    } else {
        1.5 * LABEL
    };
    let mut frame = Frame {
        area: Area {
            left,
            right,
            top: cell.top
                + if plot.title.is_empty() {
                    12.0
                } else {
                    1.6 * PANEL_TITLE
                },
            bottom: cell.bottom - x_label_height - tick_height - 8.0,
        },
        x,
        y,
    };
    let area = frame.area;
    if plot.x.to_scale || plot.y.to_scale {
        // The axis that has room shows more.
        let unit = (x.length() / area.width()).max(y.length() / area.height());
        frame.x = x.widened(unit * area.width());
        frame.y = y.widened(unit * area.height());
        (x_ticks, y_ticks) = ticks(&frame.x, &frame.y);
        x_lines = lines_of(&x_ticks);
    }
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
    for (tick, lines) in x_ticks.iter().zip(&x_lines) {
        let Some(at) = frame.x(tick.value) else {
            continue;
        };
        if plot.x.categories.is_empty() {
            canvas.line(&[(at, area.top), (at, area.bottom)], GRID, 1.0)?;
        }
        if let Some(label) = &tick.label {
            canvas.line(&[(at, area.bottom), (at, area.bottom + 6.0)], AXIS, 1.0)?;
            if is_upright {
                let middle = (at, area.bottom + 8.0 + tick_height / 2.0);
                canvas.text(label, middle, TICK, CENTRE, true)?;
                continue;
            }
            for (row, line) in lines.iter().enumerate() {
                let middle = (at, area.bottom + 8.0 + TICK * (0.5 + LEADING * row as f64));
                canvas.text(line, middle, TICK, CENTRE, false)?;
            }
        }
    }
    for mark in &plot.marks {
        marks::draw(mark, plot, &frame, canvas)?;
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

/// The width of the colours beside a depth image.
const BAR: f64 = 16.0;

fn metres(mm: u16) -> String {
    format!("{} m", f64::from(mm) / 1000.0)
}

/// The room that colours and their names take beside a depth image.
fn depth_scale_width(panel: &DepthPanel) -> f64 {
    let (near, far) = panel.range_mm;
    BAR + 24.0 + text_width(&metres(near), TICK).max(text_width(&metres(far), TICK))
}

fn draw_depth<DB: DrawingBackend>(
    panel: &DepthPanel,
    cell: Area,
    reserved: f64,
    canvas: &Canvas<DB>,
) -> Drawn {
    let (near, far) = panel.range_mm;
    let range = f64::from(far) - f64::from(near);
    let colour = |&mm: &u16| match mm {
        0 => [0, 0, 0],
        mm => viridis((f64::from(far) - f64::from(mm)) / range),
    };
    let drawn = draw_image(&panel.title, &panel.image, colour, cell, reserved, canvas)?;
    let bar = drawn.right + 12.0;
    canvas.picture(
        (bar, drawn.top),
        (BAR as usize, drawn.height() as usize),
        |_, down| viridis(1.0 - down),
    )?;
    let beside = bar + BAR + 8.0;
    for (mm, at) in [
        (near, drawn.top + TICK / 2.0),
        (far, drawn.bottom - TICK / 2.0),
    ] {
        canvas.text(&metres(mm), (beside, at), TICK, LEFT, false)?;
    }
    Ok(())
}

/// Draws an image below its title, as large as it fits beside `reserved` pixels, and returns where.
fn draw_image<DB: DrawingBackend, T>(
    title: &str,
    image: &Image<T>,
    colour: impl Fn(&T) -> [u8; 3],
    cell: Area,
    reserved: f64,
    canvas: &Canvas<DB>,
) -> Result<Area, FigureError> {
    let top = cell.top
        + if title.is_empty() {
            8.0
        } else {
            1.6 * PANEL_TITLE
        };
    let zoom = ((cell.width() - reserved - 16.0) / image.width as f64)
        .min((cell.bottom - top - 12.0) / image.height as f64);
    let size = |n: usize| ((n as f64 * zoom) as usize).max(1);
    let (width, height) = (size(image.width), size(image.height));
    let left = (cell.left + cell.right - width as f64 - reserved) / 2.0;
    // Above the image, but not beyond the cell.
    let half = text_width(title, PANEL_TITLE) / 2.0;
    let middle = (left + width as f64 / 2.0)
        .min(cell.right - half)
        .max(cell.left + half);
    let title_at = (middle, cell.top + 0.7 * PANEL_TITLE);
    canvas.text(title, title_at, PANEL_TITLE, CENTRE, false)?;
    let pixel = |across: f64, down: f64| {
        let column = (across * image.width as f64) as usize;
        let row = (down * image.height as f64) as usize;
        let pixel = image.pixels.get(row * image.width + column);
        pixel.map_or([0; 3], &colour)
    };
    canvas.picture((left, top), (width, height), pixel)?;
    Ok(Area {
        left,
        top,
        right: left + width as f64,
        bottom: top + height as f64,
    })
}
