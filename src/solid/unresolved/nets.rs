//! Nets: slots that are open in part, filled whole, so that they can be reopened from their ends.
//!
//! A slot of two cells' width is neither open nor filled for the ball: where occupied cells of both walls meet it stays out, where none lies it falls in. What is left
//! is a net: *rungs* from wall to wall, which are struts, and between them tubes.
//!
//! ```text
//!   S S S S S S S      S S S S S S S      S S S S S S S      A slot from above, S its walls.
//!   # . # # . . #      + + + + + + +      o o o o o o o      Left: as the ball left it, open (.) and crossed by occupied cells (#).
//!   # # . # . # .      + + + + + + +      o o o o o o o      Middle: filled (+). Right: reopened (o), as its walls' planes and signs say.
//!   S S S S S S S      S S S S S S S      S S S S S S S
//! ```
//!
//! Reopening ([`crate::solid::reopen`]) keeps the handles that it finds: growth neither makes nor mends one. From a slot that is filled whole it goes in from the slot's ends, and
//! makes none.

use super::{CHANGES, Kind, Narrow, STAYS, Seen};
use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::label::{Labels, Scratch};
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Runs, SliceStore};
use crate::solid::Solid;
use crate::solid::reopen::blocks::{Blocks, within};

/// A group of tubes with so many handles is a net. A bore is one handle; where two meet, there are two.
const NET: u64 = 3;

/// Pits are filled in the blocks of a net's cells and in those round them.
const ROUND: u32 = 1;

impl Narrow {
    /// Whether the group is a part of a net: rungs always are.
    fn is_in_net(&self, kind: Kind) -> bool {
        self.handles(kind) >= if kind == Kind::Tubes { NET } else { 1 }
    }
}

impl Solid {
    /// The same solid with the pits near nets filled; none if there is no net.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn with_nets_filled(&self, occupancy: &Occupancy, context: &Context) -> Result<Option<Solid>> {
        let mut labels = Vec::new();
        for kind in Kind::NARROW {
            let mut any = false;
            let judged = self.narrow_groups(occupancy, kind, context)?.judged(context, |group| {
                any |= group.is_in_net(kind);
                if group.is_in_net(kind) { CHANGES } else { STAYS }
            })?;
            labels.extend(Some(judged).filter(|_| any));
        }
        if labels.is_empty() {
            return Ok(None);
        }
        let nets = self.marked(&labels, context)?;
        let near = Blocks::with_cells(&nets, 1, self.cells, context)?.widened(ROUND, context)?;
        drop((labels, nets));
        let pits = self.pits_in(&near, occupancy, context)?;
        Ok(if pits.is_empty() { None } else { Some(self.with(&pits, context)?) })
    }

    /// The cells of the groups that have the verdict [`CHANGES`].
    fn marked(&self, labels: &[Labels], context: &Context) -> Result<SliceStore> {
        context.slices_of(self.cells[1], context.memory.chunks_in_flight, |chunk, slices| {
            let (mut bits, mut scratch) = (Bits::new(self.cells[0], self.cells[2]), Scratch::default());
            for y in chunk {
                bits.clear();
                labels.iter().try_for_each(|labels| labels.paint(y, CHANGES, &mut bits, &mut scratch))?;
                slices.push(&bits);
            }
            Ok(())
        })
    }

    /// The pits in some blocks.
    fn pits_in(&self, blocks: &Blocks, occupancy: &Occupancy, context: &Context) -> Result<SliceStore> {
        context.slices_of(self.cells[1], context.jobs(6, self.cells), |chunk, slices| {
            let mut seen = Seen::new(self, occupancy, Kind::Pits, chunk.end);
            let (mut bits, mut here) = (Bits::new(self.cells[0], self.cells[2]), Runs::default());
            for y in chunk {
                seen.paint(i64::from(y), &mut bits)?;
                blocks.read(y, &mut here)?;
                slices.push_runs(&within(&Runs::from_bits(&bits), &here));
            }
            Ok(())
        })
    }
}
