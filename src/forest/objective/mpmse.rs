//! Mapped point mean squared error: eq. 5 on m(y) in place of y (eq. 10).

use super::{Objective, mse::mse};
use crate::forest::ForestError;
use crate::forest::grow::TargetTable;

/// Eq. 10 on `mapped`, which holds the point m(y) of each target y. What the points are, and how
/// many values they have, is up to the map; splits do not depend on their scale.
pub fn mpmse(mapped: &TargetTable) -> Result<Box<dyn Objective + '_>, ForestError> {
    mse(mapped)
}
