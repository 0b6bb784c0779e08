//! The time of one frame at 640x480 on one thread, posing apart: both raster passes and the sensor,
//! for each preset, and `draw`, one exact raster pass without a sensor. The scene is that of the study
//! `speed`.

use armpose::camera::{Camera, Photographer};
use armpose::experiment::tasks::frame_times::CrowdedScene;
use armpose::random::stream;
use criterion::{Criterion, criterion_group, criterion_main};
use std::path::Path;
use std::time::Duration;

fn frame(criterion: &mut Criterion) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = CrowdedScene::read(root).expect("a sound robot and set");
    let bodies = scene.bodies();
    let mut s = stream(1, "bench", &[]);

    let mut group = criterion.benchmark_group("frame");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3));
    let photographer = |preset: &str| {
        let path = root.join(format!("data/cameras/{preset}.toml"));
        Photographer::new(&Camera::read(&path).expect("a sound preset"))
    };
    for preset in ["realistic", "render-kinect", "ideal"] {
        let mut photographer = photographer(preset);
        group.bench_function(preset, |b| {
            b.iter(|| photographer.photograph(&bodies, &mut s))
        });
    }
    let mut photographer = photographer("ideal");
    group.bench_function("draw", |b| b.iter(|| photographer.draw(&bodies)));
    group.finish();
}

criterion_group!(benches, frame);
criterion_main!(benches);
