//! Axes: from values to places, and where the ticks stand.

use super::{Axis, Mark, Shape};

/// Maps values of an axis to shares of its length, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    log: bool,
}

/// A tick: its value, and its label unless it is a minor one.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    pub value: f64,
    pub label: Option<String>,
}

impl Scale {
    /// The range of all `values` that can be shown, with a little room on both sides except where
    /// the range ends in a bound of `include` or in zero.
    pub fn new(axis: &Axis, values: impl Iterator<Item = f64>) -> Scale {
        if !axis.categories.is_empty() {
            return Scale {
                low: -0.5,
                high: axis.categories.len() as f64 - 0.5,
                log: false,
            };
        }
        let inner = |v: f64| if axis.log { v.log10() } else { v };
        let included = axis.include.map(|(low, high)| [inner(low), inner(high)]);
        let (mut low, mut high) = values
            .map(inner)
            .chain(included.into_iter().flatten())
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let room = match high - low {
            0.0 if axis.log => 0.1,
            0.0 => (0.05 * high.abs()).max(1e-9),
            length => 0.04 * length,
        };
        let fixed = |end: f64| {
            (end == 0.0 && !axis.log) || included.is_some_and(|bounds| bounds.contains(&end))
        };
        let (is_low_fixed, is_high_fixed) = (fixed(low), fixed(high));
        if !is_low_fixed || low == high {
            low -= room;
        }
        if !is_high_fixed {
            high += room;
        }
        Scale {
            low,
            high,
            log: axis.log,
        }
    }

    /// Where `value` lies, 0 at the low end and 1 at the high end; `None` when it cannot be shown.
    pub fn share(&self, value: f64) -> Option<f64> {
        let inner = if self.log { value.log10() } else { value };
        let share = (inner - self.low) / (self.high - self.low);
        share.is_finite().then(|| share.clamp(0.0, 1.0))
    }

    /// The same with a range of `length`, around the same middle.
    pub fn widened(self, length: f64) -> Scale {
        let room = (length - self.length()) / 2.0;
        Scale {
            low: self.low - room,
            high: self.high + room,
            log: self.log,
        }
    }

    pub fn length(&self) -> f64 {
        self.high - self.low
    }

    /// About `count` labelled ticks at round values.
    pub fn ticks(&self, count: usize) -> Vec<Tick> {
        if self.log {
            return self.log_ticks();
        }
        let rough = (self.high - self.low) / count.max(1) as f64;
        let unit = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 2.5, 5.0, 10.0]
            .map(|m| m * unit)
            .into_iter()
            .find(|step| *step >= 0.999 * rough)
            .unwrap_or(10.0 * unit);
        let decimals = (0..9)
            .find(|d| {
                let shifted = step * 10_f64.powi(*d);
                (shifted - shifted.round()).abs() < 1e-6 * shifted
            })
            .unwrap_or(9) as usize;
        let first = (self.low / step - 1e-9).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        (first..=last)
            .map(|i| Tick {
                value: i as f64 * step,
                label: Some(format!("{:.decimals$}", i as f64 * step)),
            })
            .collect()
    }

    /// Decades with minor ticks at 2 to 9; over less than two decades, 2 and 5 are labelled too.
    fn log_ticks(&self) -> Vec<Tick> {
        let labelled: &[i32] = if self.high - self.low < 2.0 {
            &[1, 2, 5]
        } else {
            &[1]
        };
        let mut ticks = Vec::new();
        for decade in self.low.floor() as i32..=self.high.floor() as i32 {
            for digit in 1..10 {
                // Parsed, for 3e-1 is 0.3 and 3.0 * 0.1 is not.
                let value: f64 = format!("{digit}e{decade}").parse().unwrap_or(f64::NAN);
                if (self.low - 1e-9..=self.high + 1e-9).contains(&value.log10()) {
                    let label = labelled
                        .contains(&digit)
                        .then(|| crate::experiment::table::significant(value, 6));
                    ticks.push(Tick { value, label });
                }
            }
        }
        ticks
    }
}

/// The scales of x and y that show all marks. Bars and histograms stand on zero.
pub fn scales(x: &Axis, y: &Axis, marks: &[Mark]) -> (Scale, Scale) {
    let (mut xs, mut ys) = (Vec::new(), Vec::new());
    for mark in marks {
        let mut push = |(x, y): (f64, f64)| {
            xs.push(x);
            ys.push(y);
        };
        match &mark.shape {
            Shape::Line(points) | Shape::Dashed(points) | Shape::Scatter(points) => {
                points.iter().for_each(|&point| push(point));
            }
            Shape::Areas(areas) => areas.iter().flatten().for_each(|&point| push(point)),
            Shape::Pictures(pictures) => pictures.iter().for_each(|(point, _)| push(*point)),
            Shape::Band(points) | Shape::Errors(points) => {
                for (x, low, high) in points {
                    xs.push(*x);
                    ys.extend([*low, *high]);
                }
            }
            Shape::Bars(bars) => {
                ys.push(0.0);
                for (value, error) in bars {
                    ys.push(*value);
                    ys.extend(error.iter().flat_map(|(low, high)| [*low, *high]));
                }
            }
            Shape::Histogram { edges, heights } => {
                xs.extend(edges);
                ys.push(0.0);
                ys.extend(heights);
            }
            Shape::Level(value) => ys.push(*value),
        }
    }
    (Scale::new(x, xs.into_iter()), Scale::new(y, ys.into_iter()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale, count: usize) -> Vec<String> {
        scale
            .ticks(count)
            .into_iter()
            .filter_map(|t| t.label)
            .collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let linear = Scale::new(&Axis::new("x"), [0.0, 41.3].into_iter());
        assert_eq!(labels(linear, 5), ["0", "10", "20", "30", "40"]);
        let small = Scale::new(&Axis::new("x"), [0.5, 0.95].into_iter());
        assert_eq!(labels(small, 5), ["0.5", "0.6", "0.7", "0.8", "0.9"]);
        let log = Scale::new(&Axis::new("x").log(), [0.5, 3000.0].into_iter());
        assert_eq!(labels(log, 5), ["1", "10", "100", "1000"]);
        let short = Scale::new(&Axis::new("x").log(), [1.0, 20.0].into_iter());
        assert_eq!(labels(short, 5), ["1", "2", "5", "10", "20"]);
    }

    #[test]
    fn a_widened_scale_keeps_its_middle() {
        let scale = Scale::new(&Axis::new("x"), [0.0, 41.3].into_iter());
        let wide = scale.widened(100.0);
        assert!((wide.length() - 100.0).abs() < 1e-12);
        let middle = scale.length() / 2.0; // begins at zero
        assert!((wide.share(middle).unwrap() - 0.5).abs() < 1e-12);
        assert!((wide.share(middle + 25.0).unwrap() - 0.75).abs() < 1e-12);
    }

    #[test]
    fn every_value_lies_on_its_axis_and_the_order_is_kept() {
        let values = [3.0, -2.0, 7.5, 0.1];
        for axis in [Axis::new("x"), Axis::new("x").including(0.0, 10.0)] {
            let scale = Scale::new(&axis, values.into_iter());
            let share = |v: f64| scale.share(v).unwrap();
            assert!(0.0 < share(-2.0) && share(-2.0) < share(0.1));
            assert!(share(0.1) < share(3.0) && share(3.0) < share(7.5) && share(7.5) < 1.0);
        }
        assert_eq!(
            Scale::new(&Axis::new("x").log(), [1.0, 10.0].into_iter()).share(0.0),
            None
        );
        let nothing = Scale::new(&Axis::new("x"), [f64::NAN].into_iter());
        assert!(nothing.share(0.5).is_some() && nothing.share(f64::NAN).is_none());
        let constant = Scale::new(&Axis::new("x"), [4.0, 4.0].into_iter());
        assert_eq!(constant.share(4.0), Some(0.5));
    }
}
