//! Names of columns: which of them are coordinates, in the words that surveyors and programs use.

/// Families of names of coordinates, the surest first. Where names of several are there, those of the surest count.
const FAMILIES: [[&[&str]; 3]; 4] = [
    [
        &[
            "x",
            "xcoord",
            "xcoordinate",
            "coordx",
            "coordinatex",
            "pointx",
            "posx",
            "xpos",
            "positionx",
            "utmx",
            "cartesianx",
            "centroidx",
        ],
        &[
            "y",
            "ycoord",
            "ycoordinate",
            "coordy",
            "coordinatey",
            "pointy",
            "posy",
            "ypos",
            "positiony",
            "utmy",
            "cartesiany",
            "centroidy",
        ],
        &[
            "z",
            "zcoord",
            "zcoordinate",
            "coordz",
            "coordinatez",
            "pointz",
            "posz",
            "zpos",
            "positionz",
            "utmz",
            "cartesianz",
            "centroidz",
        ],
    ],
    [
        &["easting", "eastings", "east", "utmeasting", "utme", "rechtswert", "ostwert"],
        &["northing", "northings", "north", "utmnorthing", "utmn", "hochwert", "nordwert"],
        &[
            "elevation",
            "elev",
            "height",
            "zellipsoid",
            "zellipsoidal",
            "ellipsoidalheight",
            "heightellipsoidal",
            "ellipsoidheight",
            "zorthometric",
            "zortho",
            "orthometricheight",
            "orthoheight",
            "hoehe",
            "höhe",
        ],
    ],
    [&["e"], &["n"], &["h"]],
    [
        &["lon", "long", "lng", "longitude", "xlon", "xlongitude"],
        &["lat", "latitude", "ylat", "ylatitude"],
        &["alt", "altitude", "zalt", "zaltitude"],
    ],
];

/// Units that names end with: `X_m`, `Height_ft`.
const UNITS: [&str; 10] = ["m", "ft", "cm", "mm", "km", "meters", "metres", "feet", "deg", "usft"];

/// The axis that a name means, the family it is of, and whether it is spelt in full.
fn meaning(name: &[u8]) -> Option<(usize, usize, bool)> {
    let name = std::str::from_utf8(name).ok()?.to_lowercase();
    let words: Vec<&str> =
        name.split(|c: char| c.is_whitespace() || "_-./:".contains(c)).filter(|w| !w.is_empty()).collect();
    let bare = match words.split_last() {
        Some((unit, before)) if !before.is_empty() && UNITS.contains(unit) => before.concat(),
        _ => words.concat(),
    };
    let bare = bare.strip_prefix("scalar").unwrap_or(&bare);
    FAMILIES.iter().enumerate().find_map(|(family, axes)| {
        let axis = axes.iter().position(|names| names.contains(&bare))?;
        Some((axis, family, axes[axis][0] == name))
    })
}

/// Where x, y and z stand by their names; `Err` if a name stands for one of them twice.
pub(super) fn named(names: &[&[u8]]) -> std::result::Result<[Option<usize>; 3], ()> {
    // By family and axis: the column, and whether another claims the same.
    let mut places = [[None::<(usize, bool)>; 3]; FAMILIES.len()];
    let mut twice = [[false; 3]; FAMILIES.len()];
    for (column, name) in names.iter().enumerate() {
        let Some((axis, family, full)) = meaning(name) else { continue };
        match &mut places[family][axis] {
            Some((_, known)) if *known => {}
            Some(place) if full => *place = (column, true),
            Some(_) => twice[family][axis] = true,
            place => *place = Some((column, full)),
        }
    }
    let column = |family: usize, axis: usize| places[family][axis].map(|(column, _)| column);
    let clash = |family: usize, axis: usize| twice[family][axis] && !places[family][axis].is_some_and(|(_, full)| full);
    let plane = (0..FAMILIES.len()).find(|&f| column(f, 0).is_some() && column(f, 1).is_some());
    let height = (0..FAMILIES.len()).find(|&f| column(f, 2).is_some());
    if plane.is_some_and(|f| clash(f, 0) || clash(f, 1)) || height.is_some_and(|f| clash(f, 2)) {
        return Err(());
    }
    let any = |axis| (0..FAMILIES.len()).find_map(|f| column(f, axis));
    let [x, y] = [0, 1].map(|axis| plane.map_or_else(|| any(axis), |f| column(f, axis)));
    // Without a pair of one family, one of them is not known.
    let y = if plane.is_none() && x.is_some() { None } else { y };
    Ok([x, y, any(2)])
}

/// Whether a name says what a point is called.
pub(super) fn is_identifier(name: &[u8]) -> bool {
    let bare: Vec<u8> = name.iter().filter(|b| b.is_ascii_alphanumeric()).map(u8::to_ascii_lowercase).collect();
    matches!(
        &bare[..],
        b"id"
            | b"fid"
            | b"oid"
            | b"objectid"
            | b"pointid"
            | b"ptid"
            | b"point"
            | b"pt"
            | b"nr"
            | b"no"
            | b"number"
            | b"index"
            | b"name"
            | b"label"
    )
}
