//! Angles of joints that turn all round. They have no mean on a line, where -pi and pi lie far apart:
//! each is learnt and averaged as its cosine and sine instead.

use serde::{Deserialize, Serialize};

/// Which values of a pose are such angles.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Circular(Vec<usize>);

impl Circular {
    /// The places of the angles in a pose.
    pub fn new(mut places: Vec<usize>) -> Self {
        places.sort_unstable();
        places.dedup();
        Circular(places)
    }

    /// Whether all values are ordinary numbers.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The places of the angles in a pose.
    pub fn places(&self) -> &[usize] {
        &self.0
    }

    /// Whether all places lie in a pose of so many values, each given once and in ascending order.
    pub fn fits(&self, values: usize) -> bool {
        self.0.is_sorted_by(|a, b| a < b) && self.0.last().is_none_or(|&last| last < values)
    }

    /// How many columns a pose of so many values has, see [`Self::encode`].
    pub fn columns(&self, values: usize) -> usize {
        values + self.0.len()
    }

    /// The columns of a pose: its values in order, of angles the cosine, and then the angles' sines.
    pub fn encode(&self, pose: &[f64]) -> Vec<f64> {
        let mut columns = pose.to_vec();
        for &place in &self.0 {
            columns[place] = pose[place].cos();
            columns.push(pose[place].sin());
        }
        columns
    }

    /// The pose with these columns, or, of the mean of several poses' columns, their mean: angles by
    /// the direction of their mean vector, within -pi to pi, and 0 where that has no direction.
    pub fn decode(&self, mut columns: Vec<f64>) -> Vec<f64> {
        let values = columns.len() - self.0.len();
        for (sine, &place) in (values..).zip(&self.0) {
            columns[place] = columns[sine].atan2(columns[place]);
        }
        columns.truncate(values);
        columns
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, stream, uniform};
    use std::f64::consts::{PI, TAU};

    #[test]
    fn poses_come_back_but_for_full_turns() {
        let mut s = stream(1, "circular test", &[]);
        for _ in 0..1000 {
            let pose: Vec<f64> = (0..5).map(|_| uniform(&mut s, -9.0, 9.0)).collect();
            let places = (0..below(&mut s, 6)).map(|_| below(&mut s, 5)).collect();
            let circular = Circular::new(places);
            let columns = circular.encode(&pose);
            assert!(circular.fits(5) && columns.len() == circular.columns(5));
            for (place, (back, value)) in circular.decode(columns).iter().zip(&pose).enumerate() {
                if circular.places().contains(&place) {
                    let turns = (value - back) / TAU;
                    assert!(back.abs() <= PI && (turns - turns.round()).abs() < 1e-12);
                } else {
                    assert_eq!(back, value);
                }
            }
        }
    }

    #[test]
    fn places_that_do_not_fit_are_told() {
        let circular = |json: &str| serde_json::from_str::<Circular>(json).unwrap();
        assert!(circular("[]").fits(0) && circular("[0,2]").fits(3));
        assert!(!circular("[0,3]").fits(3) && !circular("[1,1]").fits(3));
        assert!(!circular("[2,0]").fits(3));
    }
}
