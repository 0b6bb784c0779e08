//! What people see on stderr while work goes on: a bar on a terminal, plain lines elsewhere.

use super::task::Task;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Shows how far a run is and how long it will take. The tasks' estimated seconds are only weights:
/// the time left follows from how fast the work went so far.
pub struct Display {
    /// On a terminal only.
    bar: Option<ProgressBar>,
    state: Mutex<State>,
}

struct State {
    begin: Instant,
    /// Estimated seconds of all tasks, and of those that are finished.
    total: f64,
    finished: f64,
    current: Option<Current>,
    last_shown: Instant,
}

struct Current {
    label: String,
    cost: f64,
    steps: u64,
    stepped: u64,
    begin: Instant,
}

impl Display {
    /// `total` is the sum of the estimated seconds of all tasks to come.
    pub fn new(total: f64) -> Display {
        // A message wider than the terminal is cut: a bar of two lines flickers.
        let style = ProgressStyle::with_template("{bar:20} {wide_msg}");
        let bar = std::io::stderr().is_terminal().then(|| {
            ProgressBar::new(1000)
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        let now = Instant::now();
        Display {
            bar,
            state: Mutex::new(State {
                begin: now,
                total,
                finished: 0.0,
                current: None,
                last_shown: now,
            }),
        }
    }

    pub fn start(&self, task: &dyn Task) {
        self.change(|state| {
            state.current = Some(Current {
                label: task.label(),
                cost: task.cost().seconds,
                steps: task.steps(),
                stepped: 0,
                begin: Instant::now(),
            });
            true
        });
    }

    pub fn advance(&self, steps: u64) {
        self.change(|state| {
            if let Some(current) = &mut state.current {
                current.stepped += steps;
            }
            false
        });
    }

    pub fn finish(&self) {
        let mut done = None;
        self.change(|state| {
            if let Some(current) = state.current.take() {
                state.finished += current.cost;
                let seconds = current.begin.elapsed().as_secs_f64();
                done = Some(format!("{}: done in {}", current.label, duration(seconds)));
            }
            true
        });
        if let Some(done) = done {
            self.print(&done);
        }
    }

    /// A line on stderr that does not disturb the bar.
    pub fn print(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.println(line),
            None => eprintln!("{line}"),
        }
    }

    /// Changes the state and shows it, now when `change` says so and otherwise from time to time.
    fn change(&self, change: impl FnOnce(&mut State) -> bool) {
        // A thread that panicked here has at worst left a wrong number.
        let mut state = self.state.lock().unwrap_or_else(|e| e.into_inner());
        let now = change(&mut state);
        let pause = match self.bar {
            Some(_) => Duration::from_millis(100),
            None => Duration::from_secs(10),
        };
        if state.last_shown.elapsed() < pause && !(now && self.bar.is_some()) {
            return;
        }
        state.last_shown = Instant::now();
        let (share, text) = state.describe();
        match &self.bar {
            Some(bar) => {
                bar.set_position((1000.0 * share) as u64);
                bar.set_message(text);
            }
            None => eprintln!("{text}"),
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl State {
    /// How much is done, 0 to 1, and the same in words.
    fn describe(&self) -> (f64, String) {
        let (mut done, mut label) = (self.finished, String::new());
        if let Some(current) = &self.current {
            let part = current.stepped as f64 / current.steps.max(1) as f64;
            done += current.cost * part.min(1.0);
            label = match current.steps {
                0 => format!(", {}", current.label),
                _ => format!(", {} {:.0} %", current.label, 100.0 * part.min(1.0)),
            };
        }
        let share = (done / self.total.max(1e-9)).min(1.0);
        // Until a few per cent are done, the estimate is all there is.
        let elapsed = self.begin.elapsed().as_secs_f64();
        let left = match share > 0.03 {
            true => elapsed * (1.0 - share) / share,
            false => self.total - done,
        };
        let text = format!(
            "{:.0} %, about {} left{label}",
            100.0 * share,
            duration(left)
        );
        (share, text)
    }
}

/// Seconds as people say them.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match whole {
        0..10 => format!("{:.1} s", seconds.max(0.0)),
        10..60 => format!("{whole} s"),
        60..3600 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}
