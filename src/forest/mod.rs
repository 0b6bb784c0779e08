//! Random forests over binned integer features. Knows nothing of robots or images: targets come in
//! as tables.
