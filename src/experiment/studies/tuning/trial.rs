//! A setting that was tried, and which one is chosen.

use crate::estimator::error::mean_angle_error;
use crate::experiment::figure::{Axis, Mark, Panel, Plot, Shape};
use crate::experiment::statistics::{mean, standard_deviation};
use crate::experiment::table::{Cell, Table};

/// A setting and its error in each image.
pub struct Trial {
    /// What varies.
    pub sweep: &'static str,
    /// The setting's values, in the order of the tables' columns.
    pub values: Vec<Cell>,
    /// Where it stands in the figure: its place on the axis of its sweep, and which line it is of.
    pub at: (f64, String),
    /// Grows with the work that it costs.
    pub cost: f64,
    pub errors_deg: Vec<f64>,
    pub folds: Vec<usize>,
}

/// Mean absolute difference over the joints of a pose, degrees.
pub fn error_deg(truth: &[f64], pose: &[f64]) -> f64 {
    mean_angle_error(truth, pose).to_degrees()
}

impl Trial {
    pub fn error(&self) -> f64 {
        mean(&self.errors_deg)
    }

    fn standard_error(&self) -> f64 {
        standard_deviation(&self.errors_deg) / (self.errors_deg.len() as f64).sqrt()
    }

    /// Mean and standard error, over images, of how much larger the error is than `other`'s.
    fn excess(&self, other: &Trial) -> (f64, f64) {
        let pairs = self.errors_deg.iter().zip(&other.errors_deg);
        let differences: Vec<f64> = pairs.map(|(mine, theirs)| mine - theirs).collect();
        let count = differences.len() as f64;
        (
            mean(&differences),
            standard_deviation(&differences) / count.sqrt(),
        )
    }
}

/// What came of a sweep: the positions of two of the trials.
pub struct Choice {
    pub lowest: usize,
    pub chosen: usize,
}

/// The one-standard-error rule: of the settings of a sweep whose error exceeds the lowest by at most
/// one standard error of the difference, the one that costs least, of equals the first. `None` when the
/// sweep has no setting.
pub fn choose(trials: &[Trial], sweep: &str) -> Option<Choice> {
    let of_sweep = || (0..trials.len()).filter(|&i| trials[i].sweep == sweep);
    let lowest = of_sweep().min_by(|&a, &b| trials[a].error().total_cmp(&trials[b].error()))?;
    let near = of_sweep().filter(|&i| {
        let (excess, standard_error) = trials[i].excess(&trials[lowest]);
        excess <= standard_error
    });
    let chosen = near.min_by(|&a, &b| trials[a].cost.total_cmp(&trials[b].cost))?;
    Some(Choice { lowest, chosen })
}

/// The error of every setting in every image. `columns` names the settings' values.
pub fn data(columns: &[&str], trials: &[Trial]) -> Table {
    let header = ["sweep"].into_iter().chain(columns.iter().copied());
    let mut table = Table::new(header.chain(["image", "fold", "error_deg"]));
    for trial in trials {
        for (image, (&error, &fold)) in trial.errors_deg.iter().zip(&trial.folds).enumerate() {
            let result: [Cell; 3] = [image.into(), fold.into(), error.into()];
            let setting = std::iter::once(trial.sweep.into()).chain(trial.values.clone());
            table.push(setting.chain(result));
        }
    }
    table
}

/// The mean error of every setting, how much it exceeds the lowest of its sweep (of the first choice
/// where there is none for the sweep), and which were chosen.
pub fn summary(columns: &[&str], trials: &[Trial], choices: &[Choice]) -> Table {
    let header = ["sweep"].into_iter().chain(columns.iter().copied());
    let results = ["error_deg", "excess_deg", "excess_se_deg", "images", "role"];
    let mut table = Table::new(header.chain(results));
    for (i, trial) in trials.iter().enumerate() {
        let of_sweep = |c: &&Choice| trials[c.lowest].sweep == trial.sweep;
        let choice = choices.iter().find(of_sweep).or(choices.first());
        let (excess, standard_error) = choice.map_or((f64::NAN, f64::NAN), |choice| {
            trial.excess(&trials[choice.lowest])
        });
        let role = match choice {
            Some(choice) if choice.chosen == i => "chosen",
            Some(choice) if choice.lowest == i => "lowest",
            _ => "",
        };
        let result: [Cell; 5] = [
            trial.error().into(),
            excess.into(),
            standard_error.into(),
            trial.errors_deg.len().into(),
            role.into(),
        ];
        let setting = std::iter::once(trial.sweep.into()).chain(trial.values.clone());
        table.push(setting.chain(result));
    }
    table
}

/// The errors of a sweep, a line for each of its kinds, above the error of the constant pose. Whiskers
/// are drawn where there is one line.
pub fn panel(title: &str, x: Axis, trials: &[Trial], sweep: &str, constant: f64) -> Panel {
    let of_sweep = || trials.iter().filter(|trial| trial.sweep == sweep);
    let mut lines: Vec<&String> = Vec::new();
    for trial in of_sweep() {
        if !lines.contains(&&trial.at.1) {
            lines.push(&trial.at.1);
        }
    }
    let mut marks = Vec::new();
    if lines.len() == 1 {
        let bars = of_sweep().map(|t| {
            let (error, half) = (t.error(), t.standard_error());
            (t.at.0, error - half, error + half)
        });
        marks.push(Mark::new("", 0, Shape::Errors(bars.collect())));
    }
    for (colour, line) in lines.into_iter().enumerate() {
        let points = of_sweep().filter(|t| t.at.1 == *line);
        let points = points.map(|t| (t.at.0, t.error())).collect();
        marks.push(Mark::new(line, colour, Shape::Line(points)));
    }
    marks.push(Mark::new("constant pose", 7, Shape::Level(constant)));
    Panel::Plot(Plot {
        title: title.to_owned(),
        x,
        y: Axis::new("mean absolute joint error (deg)"),
        marks,
    })
}
