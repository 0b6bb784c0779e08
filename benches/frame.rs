//! The time of one frame at 640x480 on one thread, posing apart: both raster passes and the sensor,
//! for each preset, and `draw`, one exact raster pass without a sensor. The robot of the data sets
//! stands in a furnished room; its meshes are subdivided, link by link, until it has 50,000 triangles.

use armpose::camera::{Camera, Photographer};
use armpose::dataset::SetSpec;
use armpose::random::stream;
use armpose::robot::Mesh;
use armpose::scene::{PoseSampler, Rig, furnish, robot_bodies, room_body};
use criterion::{Criterion, criterion_group, criterion_main};
use std::path::Path;
use std::time::Duration;

const ROBOT_TRIANGLES: usize = 50_000;

fn triangles(rig: &Rig) -> usize {
    let links = rig.robot.links.iter();
    links.map(|link| link.mesh.triangles.len()).sum()
}

/// The same surface with every triangle cut into four at the midpoints of its edges.
fn subdivided(mesh: &Mesh) -> Mesh {
    let mut fine = Mesh::default();
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|i| mesh.vertices[i as usize]);
        let middle = |p: [f32; 3], q: [f32; 3]| [0, 1, 2].map(|i| (p[i] + q[i]) / 2.0);
        let i = fine.vertices.len() as u32;
        fine.vertices
            .extend([a, b, c, middle(a, b), middle(b, c), middle(c, a)]);
        let parts = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];
        fine.triangles
            .extend(parts.map(|part| part.map(|corner| i + corner)));
    }
    fine.welded()
}

fn frame(criterion: &mut Criterion) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let spec = SetSpec::read(&data.join("sets/pef.toml")).expect("a sound set");
    let mut rig = Rig::read(&data.join("robots/arm/robot.toml")).expect("a sound robot");
    for link in 0..rig.robot.links.len() {
        if triangles(&rig) < ROBOT_TRIANGLES {
            rig.robot.links[link].mesh = subdivided(&rig.robot.links[link].mesh);
        }
    }
    assert!(triangles(&rig) >= ROBOT_TRIANGLES);
    let mut s = stream(1, "bench", &[]);
    let sampler = PoseSampler::new(&rig, &spec.poses).expect("sound poses");
    let pose = sampler.sample(&rig.robot, &mut s);
    let root_from_link = rig.robot.forward_kinematics(&pose);
    let camera_from_root = rig.camera_from_root(&root_from_link);
    let root_from_camera = camera_from_root.inverse();
    let room = furnish(&spec.room, &spec.furniture, &root_from_camera, &[], &mut s);
    let mut bodies = robot_bodies(&rig, &root_from_link, &camera_from_root);
    bodies.push(room_body(&room, &camera_from_root));

    let mut group = criterion.benchmark_group("frame");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3));
    let photographer = |preset: &str| {
        let path = data.join(format!("cameras/{preset}.toml"));
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
