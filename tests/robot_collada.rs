//! COLLADA against mathematics: every element that can move or make a triangle, and files that attack.

use armpose::robot::{Mesh, Robot};
use std::time::{Duration, Instant};

/// The mesh of a COLLADA file with these libraries and this scene.
fn read(libraries: &str, nodes: &str) -> Result<Mesh, String> {
    let text = format!(
        "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" \
         version=\"1.4.1\"><asset><unit meter=\"1\"/><up_axis>Z_UP</up_axis></asset>{libraries}\
         <library_visual_scenes><visual_scene id=\"s\">{nodes}</visual_scene></library_visual_scenes>\
         <scene><instance_visual_scene url=\"#s\"/></scene></COLLADA>"
    );
    let folder = tempfile::tempdir().unwrap();
    let urdf = "<robot name=\"r\"><link name=\"a\"><visual><geometry><mesh filename=\"a.dae\"/>\
                </geometry></visual></link></robot>";
    std::fs::write(folder.path().join("a.dae"), text).unwrap();
    std::fs::write(folder.path().join("a.urdf"), urdf).unwrap();
    let start = Instant::now();
    let robot = Robot::from_urdf(&folder.path().join("a.urdf"));
    assert!(start.elapsed() < Duration::from_secs(10));
    let mut robot = robot.map_err(|e| e.to_string())?;
    assert!(robot.notes.is_empty(), "{:?}", robot.notes);
    Ok(robot.links.remove(0).mesh)
}

/// A geometry "g" over the points of a 2 x 1 x 0 grid: 0 1 2 below, 3 4 5 above.
fn geometry(primitives: &str) -> String {
    format!(
        "<library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array id=\"a\" count=\"18\">\
         0 0 0 1 0 0 2 0 0 0 1 0 1 1 0 2 1 0</float_array><technique_common><accessor source=\"#a\" \
         count=\"6\" stride=\"3\"><param name=\"X\"/><param name=\"Y\"/><param name=\"Z\"/></accessor>\
         </technique_common></source><vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/>\
         </vertices>{primitives}</mesh></geometry></library_geometries>"
    )
}

const INPUT: &str = "<input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/>";
const DRAW: &str = "<node><instance_geometry url=\"#g\"/></node>";

fn one_triangle() -> String {
    geometry(&format!(
        "<triangles count=\"1\">{INPUT}<p>0 1 3</p></triangles>"
    ))
}

/// Twice the area that the triangles have on the side of z: those that face down count against it.
fn facing_up(mesh: &Mesh) -> f32 {
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.vertices[i as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    mesh.triangles.iter().map(area).sum()
}

#[test]
fn every_kind_of_polygon_covers_the_grid() {
    let second = "<input semantic=\"NORMAL\" source=\"#p\" offset=\"0\"/>\
                  <input semantic=\"VERTEX\" source=\"#v\" offset=\"1\"/>";
    for (primitive, triangles, area) in [
        (
            format!("<triangles count=\"2\">{INPUT}<p>0 1 4 0 4 3</p></triangles>"),
            2,
            1.0,
        ),
        (
            format!("<triangles>{second}<p>9 0 9 1 9 4</p><p>8 0 8 4 8 3</p></triangles>"),
            2,
            1.0,
        ),
        (
            format!(
                "<polylist count=\"2\">{INPUT}<vcount>4 3</vcount><p>0 1 4 3 1 2 4</p></polylist>"
            ),
            3,
            1.5,
        ),
        (
            format!(
                "<polygons count=\"2\">{INPUT}<p>0 2 5 3</p><ph><p>0 1 4 3</p><h>0 1 4</h></ph></polygons>"
            ),
            4,
            3.0,
        ),
        (
            format!("<tristrips count=\"1\">{INPUT}<p>3 0 4 1 5 2</p></tristrips>"),
            4,
            2.0,
        ),
        (
            format!("<trifans count=\"1\">{INPUT}<p>1 2 5 4 3 0</p></trifans>"),
            4,
            2.0,
        ),
        (
            format!(
                "<lines count=\"1\">{INPUT}<p>0 1</p></lines><linestrips count=\"1\">{INPUT}<p>0 1</p>\
                 </linestrips><triangles count=\"1\">{INPUT}<p>0 1 3</p></triangles>"
            ),
            1,
            0.5,
        ),
    ] {
        let mesh = read(&geometry(&primitive), DRAW).unwrap();
        let up = facing_up(&mesh) / 2.0;
        assert_eq!(mesh.triangles.len(), triangles, "{primitive}");
        assert!((up - area).abs() < 1e-6, "{primitive}: {up}");
    }
}

/// The corner of the triangle at the grid's (1, 0, 0), and the area that faces up.
fn moved(transforms: &str) -> ([f32; 3], f32) {
    let node = format!("<node>{transforms}<instance_geometry url=\"#g\"/></node>");
    let mesh = read(&one_triangle(), &node).unwrap();
    // The second corner, unless the triangle was turned round.
    let up = facing_up(&mesh);
    let [_, b, c] = mesh.triangles[0];
    (
        mesh.vertices[if up < -1e-3 || transforms.contains("-1") {
            c
        } else {
            b
        } as usize],
        up,
    )
}

#[test]
fn transforms_multiply_in_order() {
    let close = |transforms: &str, expected: [f32; 3]| {
        let (at, _) = moved(transforms);
        for (x, e) in at.iter().zip(expected) {
            assert!((x - e).abs() < 1e-6, "{transforms}: {at:?}");
        }
    };
    close(
        "<translate>1 2 3</translate><rotate>0 0 1 90</rotate>",
        [1.0, 3.0, 3.0],
    );
    close(
        "<rotate>0 0 1 90</rotate><translate>1 2 3</translate>",
        [-2.0, 2.0, 3.0],
    );
    close(
        "<scale>2 3 4</scale><translate>1 1 1</translate>",
        [4.0, 3.0, 4.0],
    );
    close(
        "<matrix>0 0 1 5 1 0 0 6 0 1 0 7 0 0 0 1</matrix>",
        [5.0, 7.0, 7.0],
    );
    close("<rotate>0 0 0 0</rotate>", [1.0, 0.0, 0.0]);
    // Eye at (0, 0, 5), looking along y with z up: what was its right is x.
    close("<lookat>0 0 5 0 1 5 0 0 1</lookat>", [1.0, 0.0, 5.0]);
    // A mirror leaves the outside outside.
    let (at, up) = moved("<scale>-1 1 1</scale>");
    assert!(up > 0.0 && (at[0] + 1.0).abs() < 1e-6, "{at:?}");
}

#[test]
fn skins_and_morphs_are_drawn_in_the_shape_they_are_given_in() {
    let controllers = "<library_controllers><controller id=\"k\"><skin source=\"#m\"><bind_shape_matrix>\
        2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</bind_shape_matrix></skin></controller><controller id=\"m\">\
        <morph source=\"#g\"/></controller></library_controllers>";
    let node = "<node><translate>0 0 1</translate><instance_controller url=\"#k\"/></node>";
    let mesh = read(&(one_triangle() + controllers), node).unwrap();
    assert_eq!(mesh.bounds(), Some(([0.0, 0.0, 1.0], [2.0, 2.0, 1.0])));
    let loops = "<library_controllers><controller id=\"k\"><skin source=\"#k\"/></controller>\
                 </library_controllers>";
    let error = read(&(one_triangle() + loops), node).unwrap_err();
    assert!(error.contains("deform each other"), "{error}");
}

#[test]
fn points_are_where_the_accessor_says() {
    let text = one_triangle();
    // Two numbers before the first point, and one between points, in another order.
    let array = "7 7 9 0 0 0 9 0 0 1 9 0 1 0";
    let text = text.replace(
        "0 0 0 1 0 0 2 0 0 0 1 0 1 1 0 2 1 0</float_array>",
        &format!("{array}</float_array>"),
    );
    let text = text.replace(
        "count=\"6\" stride=\"3\"><param name=\"X\"/><param name=\"Y\"/><param name=\"Z\"/>",
        "count=\"3\" offset=\"2\" stride=\"4\"><param/><param name=\"Z\"/><param name=\"Y\"/>\
         <param name=\"X\"/>",
    );
    let text = text.replace("<p>0 1 3</p>", "<p>0 1 2</p>");
    let mesh = read(&text, DRAW).unwrap();
    assert_eq!(
        mesh.vertices,
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    );
}

#[test]
fn what_is_broken_or_attacks_gives_one_sentence() {
    let fine = one_triangle();
    let with = |from: &str, to: &str| {
        assert!(fine.contains(from), "{from}");
        fine.replace(from, to)
    };
    let chain: String = (0..60)
        .map(|i| {
            let next = format!("<instance_node url=\"#n{}\"/>", i + 1);
            format!("<node id=\"n{i}\">{next}{next}</node>")
        })
        .collect();
    let chain = format!("<library_nodes>{chain}<node id=\"n60\"/></library_nodes>");
    let cycle = "<library_nodes><node id=\"c\"><node><instance_node url=\"#c\"/></node></node></library_nodes>";
    let deep = "<node>".repeat(20_000) + &"</node>".repeat(20_000);
    for (libraries, nodes, part) in [
        (
            fine.clone(),
            "<node><instance_node url=\"#c\"/></node>".to_owned(),
            "that does not exist",
        ),
        (
            fine.clone() + cycle,
            "<node><instance_node url=\"#c\"/></node>".to_owned(),
            "instances itself",
        ),
        (
            fine.clone() + &chain,
            "<node><instance_node url=\"#n0\"/></node>".to_owned(),
            "too many nodes",
        ),
        (fine.clone(), deep.clone() + DRAW, "too many nodes"),
        (
            fine.clone(),
            "<node><instance_geometry url=\"a.dae#g\"/></node>".to_owned(),
            "not in the same file",
        ),
        (fine.clone(), "<node/>".to_owned(), "no triangles"),
        (
            fine.clone(),
            format!("<node><skew>1 1 0 0 0 1 0</skew></node>{DRAW}"),
            "<skew>",
        ),
        (
            fine.clone(),
            format!("<node><matrix>1 2</matrix></node>{DRAW}"),
            "16 finite numbers",
        ),
        (
            fine.clone(),
            format!("<node><scale>1 nan 1</scale></node>{DRAW}"),
            "3 finite numbers",
        ),
        (
            fine.clone(),
            format!("<node><translate>1 x 1</translate></node>{DRAW}"),
            "no number that fits",
        ),
        (
            fine.clone(),
            format!("<node><matrix>1 0 0 0 0 1 0 0 0 0 1 0 5 6 7 1</matrix></node>{DRAW}"),
            "last row",
        ),
        (
            with("<p>0 1 3</p>", "<p>0 1 6</p>"),
            DRAW.to_owned(),
            "does not exist",
        ),
        (
            with("<p>0 1 3</p>", "<p>0 1 -1</p>"),
            DRAW.to_owned(),
            "no number that fits",
        ),
        (
            with("<p>0 1 3</p>", "<p>0 1 3 4</p>"),
            DRAW.to_owned(),
            "cut off",
        ),
        (
            with("triangles count=\"1\"", "triangles count=\"4294967295\""),
            DRAW.to_owned(),
            "lists 1",
        ),
        (
            with("count=\"6\" stride", "count=\"7\" stride"),
            DRAW.to_owned(),
            "<accessor>",
        ),
        (
            with("count=\"6\" stride=\"3\"", "count=\"9\" stride=\"2\""),
            DRAW.to_owned(),
            "<accessor>",
        ),
        (
            with("stride=\"3\"", "stride=\"18446744073709551615\""),
            DRAW.to_owned(),
            "<accessor>",
        ),
        (
            with(
                "count=\"6\" stride=\"3\"",
                "count=\"6\" offset=\"-1\" stride=\"3\"",
            ),
            DRAW.to_owned(),
            "offset",
        ),
        (
            with("offset=\"0\"", "offset=\"18446744073709551615\""),
            DRAW.to_owned(),
            "offset",
        ),
    ] {
        let error = read(&libraries, &nodes).map(drop).expect_err(part);
        assert!(
            error.contains(part) && !error.contains('\n'),
            "{part}: {error}"
        );
        assert!(error.len() < 600);
    }
}

#[test]
fn many_instances_are_bounded() {
    let instances = DRAW.repeat(99_000);
    let error = read(&one_triangle(), &instances).map(drop);
    assert!(error.unwrap_err().contains("too many nodes"));
    // One geometry of 64,000 triangles a thousand times.
    let many = "0 1 3 ".repeat(64_000);
    let big = geometry(&format!("<triangles>{INPUT}<p>{many}</p></triangles>"));
    let error = read(&big, &DRAW.repeat(1000)).map(drop);
    assert!(error.unwrap_err().contains("more than 4000000 triangles"));
}
