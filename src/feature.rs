//! Depth-difference features (eq. 4) and the matrix of their values.
