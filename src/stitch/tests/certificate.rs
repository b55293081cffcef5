//! What tells that a seam is clean: nothing that it needs goes unnoticed.

use super::*;
use crate::stitch::numbers::BEFORE;
use crate::stitch::reach::{OFF, Part};
use crate::surface::untangle::broad_phase::BLOCK;

/// What the closing of a seam has left otherwise in the slab above it, and has not taken note of: vertices, corners of triangles, boxes of blocks.
fn unnoticed(fresh: &SlabMesh<f32>, closed: &SlabMesh<f32>, touched: u32) -> usize {
    let own = fresh.own();
    let differs = |v: u32| {
        let at = InSlab(v).at();
        let states = fresh.state[at] != closed.state[at] || fresh.stars.also[at] != closed.stars.also[at];
        states || fresh.quantized[at] != closed.quantized[at] || fresh.position(InSlab(v)) != closed.position(InSlab(v))
    };
    let vertices = (touched..own).filter(|v| differs(*v)).count();
    let corners = |t: usize| fresh.triangles[t].into_iter().filter(|v| *v < own);
    let is_renamed = |t: &usize| fresh.triangles[*t] != closed.triangles[*t];
    let renamed = (0..fresh.triangles.len()).filter(is_renamed).filter(|t| corners(*t).any(|v| v >= touched)).count();
    // Whoever looks into a block reads all its corners: one that is touched is enough.
    let is_seen = |block: usize| {
        let triangles = block * BLOCK..((block + 1) * BLOCK).min(fresh.triangles.len());
        triangles.flat_map(corners).any(|v| v < touched)
    };
    let blocks = fresh.blocks.iter().zip(&closed.blocks).enumerate();
    let widened = blocks.filter(|(block, (fresh, closed))| fresh != closed && !is_seen(*block)).count();
    vertices + renamed + widened
}

/// Nothing that a seam leaves otherwise goes unnoticed; and a seam that reads what must stay, or whose outcome depends on a triangle that names the slab before, is not clean. With any part of
/// that switched off, something is missed.
#[test]
#[ignore = "exhaustive"]
fn each_part_of_the_certificate_is_needed() {
    let (mut missed, mut settled, mut beyond, mut seams) = ([0; 2], [0; 2], [0; 2], 0);
    for slab_slices in [None, Some(12)] {
        for case in cases(8..10, slab_slices) {
            Stitching::of(&case, |stitching| {
                // All that is left otherwise, with the first part and without it.
                for (off, missed) in [None, Some(Part::Touched)].into_iter().zip(&mut missed) {
                    OFF.set(off);
                    let mut stitcher = stitching.stitcher(&Checkpoint::at(0));
                    for (number, slab) in stitching.slabs.iter().enumerate() {
                        stitcher.add(slab.clone()).unwrap();
                        let closed = stitcher.waiting.as_ref().unwrap();
                        *missed += if number > 0 { unnoticed(slab, closed, stitcher.touched) } else { 0 };
                    }
                    OFF.set(None);
                }
                // Where the slab before names vertices up to one that a clean seam reads, that seam is not clean.
                let (whole, _) = stitching.run(&Checkpoint::at(0));
                for (number, report) in (1..).zip(&whole.seams) {
                    let Some([lowest, _]) = report.read.filter(|_| report.clean && number > 1) else { continue };
                    seams += 1;
                    let mut stitcher = stitching.stitcher(&Checkpoint::at(0));
                    stitching.slabs[..number].iter().for_each(|slab| drop(stitcher.add(slab.clone()).unwrap()));
                    let lower = stitcher.waiting.clone().unwrap();
                    let frozen = stitcher.frozen;
                    let closed = |stitcher: &mut Stitcher<'_, f32>, mut lower: SlabMesh<f32>, off| {
                        let mut upper = stitching.slabs[number].clone();
                        OFF.set(off);
                        let (report, ..) = stitcher.close(&mut lower, &mut upper);
                        OFF.set(None);
                        (report.clean, changeable(&upper))
                    };
                    stitcher.frozen = frozen.max(lower.planes[(lowest + 1 - lower.slices.start) as usize]);
                    for (off, settled) in [None, Some(Part::Settled)].into_iter().zip(&mut settled) {
                        *settled += usize::from(closed(&mut stitcher, lower.clone(), off).0);
                    }
                    // All corners of a triangle are made to be vertices of the slab before.
                    stitcher.frozen = frozen;
                    let (_, expected) = closed(&mut stitcher, lower.clone(), None);
                    for t in (0..lower.triangles.len()).rev().step_by(11).take(12) {
                        let mut named = lower.clone();
                        named.triangles[t] = [0, 1, 2].map(|v| BEFORE + v);
                        for (off, beyond) in [None, Some(Part::Beyond)].into_iter().zip(&mut beyond) {
                            let (clean, found) = closed(&mut stitcher, named.clone(), off);
                            *beyond += usize::from(clean && found != expected);
                        }
                    }
                }
            });
        }
    }
    assert_eq!((missed[0], settled[0], beyond[0]), (0, 0, 0));
    let missed = [missed[1], settled[1], beyond[1]];
    assert!(missed.iter().all(|missed| *missed > 10), "{missed:?} of {seams} seams");
}
