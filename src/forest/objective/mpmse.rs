//! Mapped point mean squared error: eq. 5 on m(y) in place of y (eq. 10).

use super::{Made, mse::mse_of};
use crate::forest::grow::TargetTable;
use std::borrow::Cow;

/// Eq. 10 on `points`, which holds m(y) for each target y, `dimensions` numbers each. What the
/// points are is up to the map; splits do not depend on their scale.
pub fn mpmse<'a>(points: Vec<f64>, dimensions: usize) -> Made<'a> {
    mse_of(Cow::Owned(TargetTable::new(dimensions, points)?))
}
