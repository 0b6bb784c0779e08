//! The time of one frame: both raster passes and the sensor, at 640x480, one thread.

#[path = "../tests/camera_scene/mod.rs"]
mod camera_scene;

use armpose::camera::{Camera, Photographer};
use armpose::random::stream;
use camera_scene::{bodies, furnished_room};
use criterion::{Criterion, criterion_group, criterion_main};
use std::path::Path;
use std::time::Duration;

fn frame(criterion: &mut Criterion) {
    let things = furnished_room(20, 50);
    let bodies = bodies(&things);
    let triangles: usize = bodies.iter().map(|body| body.mesh.triangles.len()).sum();
    assert!(triangles >= 50_000, "{triangles} triangles");
    let mut group = criterion.benchmark_group("frame");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    for preset in ["realistic", "render-kinect", "ideal"] {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("data/cameras/{preset}.toml"));
        let mut photographer = Photographer::new(&Camera::read(&path).expect("a sound preset"));
        let mut noise = stream(1, "bench", &[]);
        group.bench_function(preset, |b| {
            b.iter(|| photographer.photograph(&bodies, &mut noise))
        });
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cameras/ideal.toml");
    let mut photographer = Photographer::new(&Camera::read(&path).expect("a sound preset"));
    group.bench_function("draw", |b| b.iter(|| photographer.draw(&bodies)));
    group.finish();
}

criterion_group!(benches, frame);
criterion_main!(benches);
