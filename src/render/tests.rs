//! Whole pictures of meshes that are known.

use super::*;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema};
use crate::points::scalar::Scalar;

/// A mesh in temporary storage, and its folder.
struct Made {
    mesh: MeshSpool,
    workspace: Workspace,
    _dir: tempfile::TempDir,
}

fn mesh_with(vertices: &[[f64; 3]], faces: &[[u32; 3]], schema: Schema, records: &[u8]) -> Made {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mut mesh = MeshSpool::with_attributes(&workspace, Precision::Double, schema, 1 << 24);
    mesh.append_vertices(vertices).unwrap();
    mesh.append_attributes(records).unwrap();
    mesh.append_faces(&faces.iter().map(|face| FaceRecord::new(*face)).collect::<Vec<_>>()).unwrap();
    Made { mesh, workspace, _dir: dir }
}

fn mesh(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Made {
    mesh_with(vertices, faces, Schema::default(), &[])
}

fn options(width: u32, height: u32, views: &str) -> Options {
    let views = views.split(',').map(|view| view.parse().unwrap()).collect();
    Options { size: Size { width, height }, views, colour_by: ColourBy::None, ..Options::default() }
}

fn picture(made: &Made, options: &Options) -> Picture {
    render(&made.mesh, options, 64 << 20, &Workers::new(2).unwrap(), &made.workspace, &mut |_| {}).unwrap()
}

impl Picture {
    fn at(&self, x: usize, y: usize) -> &[u8] {
        let at = (y * self.size.width as usize + x) * self.channels;
        &self.pixels[at..at + self.channels]
    }
}

/// A cube of side 2 round the origin, normals out.
fn cube() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let vertices = (0..8).map(|i| [0, 1, 2].map(|a| if i >> a & 1 == 0 { -1.0 } else { 1.0 })).collect();
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let faces = sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    (vertices, faces)
}

/// A ball of radius 1 with `rings` rings of as many quadrilaterals.
fn ball(rings: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let angle = |i: u32| std::f64::consts::PI * f64::from(i) / f64::from(rings);
    for ring in 0..=rings {
        for i in 0..rings {
            let ((s, c), (sin, cos)) = (angle(ring).sin_cos(), (2.0 * angle(i)).sin_cos());
            vertices.push([s * cos, s * sin, c]);
            let next = |i: u32, ring: u32| ring * rings + (i + 1) % rings;
            if ring < rings {
                let (a, b) = (ring * rings + i, ring * rings + i + rings);
                faces.extend([[a, b, next(i, ring)], [next(i, ring), b, next(i, ring + 1)]]);
            }
        }
    }
    (vertices, faces)
}

#[test]
fn a_cube_has_known_pixels() {
    let (vertices, faces) = cube();
    let made = mesh(&vertices, &faces);
    for shading in [Shading::Flat, Shading::Smooth] {
        let picture = picture(&made, &Options { shading, ..options(100, 100, "top") });
        assert_eq!(picture.triangles, 12);
        // The margin is 4 pixels.
        let middle = picture.at(50, 50);
        for y in 0..100 {
            for x in 0..100 {
                let inside = (4..96).contains(&x) && (4..96).contains(&y);
                if shading == Shading::Flat {
                    assert_eq!(picture.at(x, y), if inside { middle } else { &[255; 3] }, "{x} {y}");
                } else {
                    assert_eq!(picture.at(x, y) == [255; 3], !inside, "{x} {y}");
                }
            }
        }
        assert!(middle.iter().all(|c| (150..250).contains(c)), "{middle:?}");
    }
}

#[test]
fn an_edge_in_a_pixel_is_as_much_of_it_as_it_covers() {
    // 100 pixels for 2 units, and another margin: the square's sides lie a third of a pixel inside.
    let (vertices, faces) = cube();
    let picture = picture(&mesh(&vertices, &faces), &Options { shading: Shading::Flat, ..options(93, 93, "top") });
    // 93 * .04 = 3.72: samples at 3.5 are outside, at 3.83 inside.
    let (edge, inside) = (shading::linear([picture.at(3, 46)[0]; 3]).x, shading::linear([picture.at(46, 46)[0]; 3]).x);
    assert!((edge - (inside / 3.0 + 2.0 / 3.0)).abs() < 0.01, "{edge} {inside}");
    assert_eq!(picture.at(2, 46), [255; 3]);
}

#[test]
fn a_ball_is_round_and_lit_from_the_upper_left() {
    let (vertices, faces) = ball(60);
    let made = mesh(&vertices, &faces);
    let picture = picture(&made, &options(200, 200, "front"));
    let covered = (0..200 * 200).filter(|i| picture.at(i % 200, i / 200) != [255; 3]).count() as f64;
    let disc = std::f64::consts::PI * 92.0 * 92.0;
    assert!((covered / disc - 1.0).abs() < 0.02, "{covered} {disc}");
    let brightness = |x, y| picture.at(x, y).iter().map(|c| u32::from(*c)).sum::<u32>();
    assert!(brightness(60, 60) > brightness(100, 100) && brightness(100, 100) > brightness(140, 160));
    // Smooth: from one pixel to the next the light hardly changes.
    for x in 30..170 {
        assert!(brightness(x, 110).abs_diff(brightness(x + 1, 110)) < 20, "{x}");
    }
}

#[test]
fn means_and_the_order_of_vertices_do_not_show() {
    let (vertices, faces) = ball(220);
    assert!(faces.len() > 2 * BLOCK);
    let mut options = Options { colour_by: ColourBy::Height, ..options(150, 110, "iso,top") };
    let expected = picture(&mesh(&vertices, &faces), &options);
    // Another number for each vertex, so that all blocks are far.
    let count = vertices.len() as u32;
    let number = |v: u32| (u64::from(v) * 7_919 % u64::from(count)) as u32;
    let mut moved = vertices.clone();
    (0..count).for_each(|v| moved[number(v) as usize] = vertices[v as usize]);
    let renumbered: Vec<[u32; 3]> = faces.iter().map(|face| face.map(number)).collect();
    for made in [mesh(&vertices, &faces), mesh(&moved, &renumbered)] {
        for (threads, in_flight, window, far, in_memory, tiles, range) in [
            (1, 1, 100, 0, 0, 1, 4096),
            (3, 4, 5000, 1 << 23, 1 << 20, 1 << 20, 10_000),
            (2, 3, 5000, 1 << 30, 1 << 20, 1 << 20, 10_000),
            (2, 3, 1 << 18, 0, 1 << 24, 1 << 28, 1 << 20),
        ] {
            let plan = Plan { sizes: Sizes { in_flight, window, far, in_memory }, range, tiles };
            let workers = Workers::new(threads).unwrap();
            let (mut told, mut most) = (0, 0);
            let progress = &mut |done| {
                assert!(done >= told && done <= faces.len() as u64);
                (told, most) = (done, done);
            };
            let drawn = draw(&made.mesh, &options, plan, &workers, &made.workspace, progress).unwrap();
            assert!(drawn == expected, "{threads} threads, window {window}");
            assert_eq!(most, faces.len() as u64);
        }
    }
    options.shading = Shading::Flat;
    assert!(picture(&mesh(&moved, &renumbered), &options) == picture(&mesh(&vertices, &faces), &options));
}

#[test]
fn budgets_do_not_show_and_too_small_ones_are_refused() {
    let (vertices, faces) = ball(40);
    let made = mesh(&vertices, &faces);
    let options = options(300, 200, "iso,back");
    let least = least_memory(&options);
    let workers = Workers::new(2).unwrap();
    let with = |budget| render(&made.mesh, &options, budget, &workers, &made.workspace, &mut |_| {});
    let expected = with(1 << 30).unwrap();
    assert!(with(least).unwrap() == expected);
    assert!(with(least + (5 << 20)).unwrap() == expected);
    assert!(matches!(with(least - (1 << 20) - 1), Err(Error::Budget { needed, .. }) if needed.0 == least));
}

#[test]
fn vertices_have_the_normals_of_a_naive_sum() {
    let (vertices, faces) = ball(50);
    let made = mesh(&vertices, &faces);
    let sizes = Sizes { in_flight: 2, window: 64, far: 0, in_memory: 0 };
    let workers = Workers::new(2).unwrap();
    let blocks = Blocks::survey(&made.mesh, &[], sizes, &workers, &made.workspace, &mut |_| {}).unwrap();
    let tint = Tint::One([0; 3]);
    let told = &mut |_| {};
    let known = Vertices::of(&blocks, &tint, Shading::Smooth, (sizes, 300), &workers, &made.workspace, told).unwrap();
    let (mut piece, mut out) = (Piece::default(), Vec::new());
    blocks.read(0, &mut piece).unwrap();
    known.read(&blocks, 0, &piece, &mut out).unwrap();
    for (v, position) in vertices.iter().enumerate().filter(|(v, _)| (50..50 * 50).contains(v)) {
        let sum = faces.iter().filter(|face| face.contains(&(v as u32))).fold(DVec3::ZERO, |sum, face| {
            let [a, b, c] = face.map(|v| DVec3::from_array(vertices[v as usize]));
            sum + (b - a).cross(c - a)
        });
        let at = faces.iter().flatten().position(|u| *u as usize == v).unwrap();
        let (normal, smooth) = out[piece.local[at / 3][at % 3] as usize].normal().unwrap();
        assert!((normal.as_dvec3() - sum.normalize()).length() < 2e-4, "{position:?}");
        assert_eq!(smooth, 1.0);
    }
}

#[test]
fn edges_of_a_cube_are_known_and_stay() {
    let (vertices, faces) = cube();
    let made = mesh(&vertices, &faces);
    let smooth = picture(&made, &options(120, 120, "iso"));
    let flat = picture(&made, &Options { shading: Shading::Flat, ..options(120, 120, "iso") });
    let differ = |a: &u8, b: &u8| a.abs_diff(*b) > 24;
    let count = smooth.pixels.iter().zip(&flat.pixels).filter(|(a, b)| differ(a, b)).count();
    assert!(count < smooth.pixels.len() / 20, "{count} of {}", smooth.pixels.len());
}

#[test]
fn a_back_has_another_tone_but_not_a_single_triangle_that_was_turned_over() {
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.1]];
    let fan = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    let red = |picture: &Picture, x, y| {
        let [r, _, b] = picture.at(x, y) else { panic!("three channels") };
        i32::from(*r) - i32::from(*b) > 60
    };
    let made = mesh(&square, &fan);
    let (top, bottom) = (picture(&made, &options(50, 50, "top")), picture(&made, &options(50, 50, "bottom")));
    assert!(!red(&top, 25, 20) && red(&bottom, 25, 20));
    let (vertices, mut faces) = ball(20);
    let turned = faces.len() / 4 + 20;
    faces[turned].swap(0, 1);
    let made = mesh(&vertices, &faces);
    for view in ["front", "back", "left", "right", "top", "iso"] {
        let picture = picture(&made, &options(100, 100, view));
        assert!((0..100 * 100).all(|i| !red(&picture, i % 100, i / 100)), "{view}");
    }
}

#[test]
fn colours_are_those_of_vertices() {
    let schema = Schema::new(
        [("red", Scalar::U8), ("green", Scalar::U8), ("blue", Scalar::U8), ("classification", Scalar::U8)]
            .map(|(name, scalar)| Attribute::new(name, scalar))
            .to_vec(),
    );
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let records = [[250, 20, 20, 2], [20, 20, 250, 6], [20, 20, 250, 6], [250, 20, 20, 2]].concat();
    let made = mesh_with(&square, &[[0, 1, 2], [0, 2, 3]], schema, &records);
    let by = |colour: &str| {
        let options = Options { colour_by: colour.parse().unwrap(), ..options(100, 100, "top") };
        picture(&made, &options)
    };
    let rgb = by("rgb");
    assert!(rgb.at(8, 50)[0] > 4 * rgb.at(8, 50)[2] && rgb.at(91, 50)[2] > 4 * rgb.at(91, 50)[0]);
    let classes = by("class");
    let tones: std::collections::BTreeSet<&[u8]> = (6..94).map(|x| classes.at(x, 50)).collect();
    assert!(tones.len() <= 3, "two colours, and a pixel of both: {tones:?}");
    assert!(by("height").at(50, 50) != by("none").at(50, 50));
    let gone = Options { colour_by: "gps_time".parse().unwrap(), ..options(9, 9, "top") };
    let error = render(&made.mesh, &gone, 1 << 26, &Workers::new(1).unwrap(), &made.workspace, &mut |_| {});
    let error = error.unwrap_err().to_string();
    assert!(error.ends_with("no attribute gps_time; there are: red, green, blue, classification"), "{error}");
}

#[test]
fn a_transparent_background_is_seen_through() {
    let (vertices, faces) = ball(30);
    let made = mesh(&vertices, &faces);
    let options = options(60, 60, "top");
    let white = picture(&made, &options);
    let clear = picture(&made, &Options { background: Background::Transparent, ..options.clone() });
    let black = picture(&made, &Options { background: Background::Colour([0; 3]), ..options });
    assert_eq!((clear.channels, clear.at(0, 0)[3], clear.at(30, 30)[3]), (4, 0, 255));
    assert_eq!((&clear.at(30, 30)[..3], black.at(30, 30)), (white.at(30, 30), white.at(30, 30)));
    assert_eq!((white.at(0, 0), black.at(0, 0)), ([255; 3].as_slice(), [0; 3].as_slice()));
}

#[test]
fn strange_meshes_make_pictures_all_the_same() {
    let nan = [f64::NAN, 0.0, 0.0];
    let triangle = [[0, 1, 2]];
    let unit = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let scaled = |scale: f64| unit.map(|p| p.map(|c| c * scale));
    for (name, vertices, faces, drawable) in [
        ("nothing", vec![], vec![], 0),
        ("no triangles", unit.to_vec(), vec![], 0),
        ("one place", vec![[3.0; 3]; 3], triangle.to_vec(), 1),
        ("a line", vec![[0.0; 3], [1.0; 3], [2.0; 3]], triangle.to_vec(), 1),
        ("one vertex three times", unit.to_vec(), vec![[1, 1, 1]], 1),
        ("not finite", vec![nan; 3], triangle.to_vec(), 0),
        ("infinite", vec![[f64::INFINITY, 0.0, 0.0], [0.0; 3], [1.0; 3]], triangle.to_vec(), 0),
        ("huge", scaled(1e99).to_vec(), triangle.to_vec(), 1),
        ("too huge", scaled(1e300).to_vec(), triangle.to_vec(), 0),
        ("tiny", scaled(1e-300).to_vec(), triangle.to_vec(), 1),
        ("less than tiny", scaled(5e-324).to_vec(), triangle.to_vec(), 1),
        ("far away", unit.map(|p| p.map(|c| c + 4.5e6)).to_vec(), triangle.to_vec(), 1),
    ] {
        let made = mesh(&vertices, &faces);
        for shading in [Shading::Smooth, Shading::Flat] {
            for colour in [ColourBy::None, ColourBy::Height] {
                let options = Options { shading, colour_by: colour, ..options(40, 30, "iso,top") };
                let drawn = picture(&made, &options);
                assert_eq!(drawn.triangles, drawable, "{name}");
                assert_eq!(drawn.pixels.len(), 40 * 30 * 3);
                let shown = drawn.pixels.iter().any(|c| *c < 200);
                if ["huge", "far away"].contains(&name) {
                    assert!(shown, "{name}");
                }
            }
        }
    }
    // What is not finite leaves the others where they are.
    let mut vertices = unit.to_vec();
    vertices.push(nan);
    let with = picture(&mesh(&vertices, &[[0, 1, 2], [0, 3, 1]]), &options(50, 50, "top"));
    let without = picture(&mesh(&unit, &triangle), &options(50, 50, "top"));
    assert_eq!(with, without);
}

#[test]
fn a_picture_of_a_single_pixel() {
    let (vertices, faces) = ball(12);
    let one = picture(&mesh(&vertices, &faces), &options(1, 1, "iso"));
    assert_eq!(one.pixels.len(), 3);
    assert_ne!(one.pixels, [255; 3]);
}
