//! What a mesh file says of its making.

use crate::error::Result;
use crate::format::write;
use crate::input::Cloud;
use crate::mesh::MeshHeader;
use crate::points::attribute::Wanted;
use crate::resources::workers::Workers;
use crate::run::bridging::Trimmed;
use crate::run::surface::Reconstructed;
use crate::run::surveyed::Surveyed;
use crate::settings::Settings;
use crate::solid::close::How;

/// The header of a mesh: where all attributes are carried, those that never change stand in it.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub(crate) fn header_of(
    cloud: &Cloud,
    surveyed: &Surveyed,
    settings: &Settings,
    made: &Reconstructed,
    attributes: &Wanted,
    workers: &Workers,
) -> Result<MeshHeader> {
    let mut header = header(cloud, surveyed, settings, made);
    if *attributes == Wanted::All {
        for (name, value) in write::constant(&made.mesh, workers)? {
            header.comments.push(format!("constant {name} {value}"));
            header.constant.push(name);
        }
    }
    Ok(header)
}

/// What the mesh file says of its making: nothing that depends on means, so that the same points give the same bytes.
fn header(cloud: &Cloud, surveyed: &Surveyed, settings: &Settings, made: &Reconstructed) -> MeshHeader {
    let grid = &surveyed.grid;
    let surface = settings.surface;
    let words = |value: &dyn std::fmt::Debug| format!("{value:?}").to_lowercase();
    let closing = match &made.how {
        How::Ball(closing) => format!("radius {}", closing.rho()),
        How::Sign(_) => "auto".to_owned(),
    };
    let mut header = MeshHeader {
        crs: cloud.crs().cloned(),
        sheet: settings.may_end(),
        constant: Vec::new(),
        origin: made.origin,
        comments: vec![
            format!("asra-stream {}", env!("CARGO_PKG_VERSION")),
            format!("cell_size {} slices {}", grid.cell_size(), grid.cells()[1]),
            format!(
                "axis {} closing {} smooth {} diagonals {} fit {}",
                grid.axis().letter(),
                closing,
                surface.smooth,
                words(&surface.diagonals),
                words(&surface.fit)
            ),
        ],
    };
    if let Some(open) = &settings.open {
        let base = open.base.map_or_else(String::new, |base| format!(" base {base}"));
        let hole = 2 * open.bridge(grid);
        header.comments.push(format!(
            "surface {} facing {} max_hole {hole} cells{base}",
            words(&open.kind),
            open.facing
        ));
    }
    if let Some(Trimmed { distance, .. }) = made.trimmed {
        header.comments.push(format!("trim {distance}"));
    }
    header
}
