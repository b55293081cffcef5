//! Places on Earth beside two other implementations.

use proj4rs::Proj;
use proj4rs::transform::transform;

use super::*;
use crate::points::unit::Unit;

fn earth(text: &str) -> Earth {
    Earth::of(&Crs::parse(text).unwrap(), 0.0).unwrap_or_else(|words| panic!("{text}: {words}"))
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum::<f64>().sqrt()
}

/// By pyproj 3.7.2 (PROJ 9.5.1): to the system's own longitude and latitude, then `+proj=cart` of its ellipsoid; the last three by `+towgs84` of their definitions.
const KNOWN_PLACES: [(&str, [f64; 3], [f64; 3]); 16] = [
    ("EPSG:25832", [500_000.0, 5_400_000.0, 250.0], [4_161_417.699_57, 659_103.813_30, 4_772_682.271_62]),
    ("EPSG:25832", [512_345.678, 5_403_210.987, 123.456], [4_157_009.367_22, 670_910.398_30, 4_774_695.451_66]),
    ("EPSG:25832", [280_000.25, 5_890_000.75, -3.5], [3_817_485.607_49, 381_887.364_16, 5_078_164.631_74]),
    ("EPSG:5555", [512_345.678, 5_403_210.987, 123.456], [4_157_009.367_22, 670_910.398_30, 4_774_695.451_66]),
    ("EPSG:32733", [612_000.5, 6_234_567.25, 1089.0], [5_082_206.932_24, 1_477_778.941_37, -3_549_222.972_65]),
    // Feet, with heights in feet, too; then with heights in metres, and in survey feet by their code.
    ("EPSG:2992", [637_000.0, 850_000.0, 400.0], [-2_505_381.723_37, -3_847_692.340_54, 4_412_403.216_76]),
    ("EPSG:2992+5703", [637_000.0, 850_000.0, 121.92], [-2_505_381.723_37, -3_847_692.340_54, 4_412_403.216_76]),
    ("EPSG:2229+6360", [6_480_000.0, 1_845_000.0, 310.5], [-2_505_219.845_40, -4_658_610.867_70, 3_552_185.149_96]),
    ("EPSG:4326", [11.5, 48.1375, 519.0], [4_179_075.146_65, 850_242.448_05, 4_727_479.451_11]),
    (
        "EPSG:4978",
        [4_179_075.146_65, 850_242.448_05, 4_727_479.451_11],
        [4_179_075.146_65, 850_242.448_05, 4_727_479.451_11],
    ),
    ("EPSG:3857", [1_279_000.0, 6_130_000.0, 520.0], [4_179_115.724_15, 849_449.560_18, 4_727_586.743_37]),
    ("EPSG:3035", [4_321_000.0, 3_210_000.0, 100.0], [3_875_240.206_24, 683_309.405_09, 5_002_882.146_44]),
    ("EPSG:3031", [-1_250_000.5, 750_000.25, 1500.0], [760_745.730_58, -1_267_909.635_50, -6_185_117.320_44]),
    ("EPSG:5070", [-1_500_000.0, 1_800_000.0, 2100.0], [-1_994_534.462_25, -4_622_143.313_22, 3_906_689.392_93]),
    ("EPSG:2154", [652_469.02, 6_862_035.26, 35.0], [4_200_937.804_08, 172_560.718_71, 4_780_107.699_50]),
    ("EPSG:2193", [1_570_598.0, 5_180_272.0, 18.0], [-4_593_416.212_11, 593_635.124_11, -4_370_384.453_19]),
];

#[test]
fn places_agree_with_another_program_to_the_millimetre() {
    for (system, place, expected) in KNOWN_PLACES {
        let found = earth(system).centred(place).unwrap();
        assert!(apart(found, expected) < 1e-3, "{system} {place:?}: {found:?} {expected:?}");
    }
}

/// Every code's system that is known here, in the middle of its map and beside it, against the crate `proj4rs`. It takes the functions of the system's library, whose
/// last bits differ between machines.
#[test]
fn all_systems_agree_with_another_implementation() {
    let centred = Proj::from_proj_string("+proj=geocent +datum=WGS84 +units=m +no_defs").unwrap();
    let degrees = |definition: &str| {
        let words = definition
            .split(' ')
            .filter(|word| ["+ellps", "+a=", "+b=", "+rf", "+datum", "+pm"].iter().any(|key| word.starts_with(key)));
        Proj::from_proj_string(&format!("+proj=longlat {}", words.collect::<Vec<_>>().join(" "))).unwrap()
    };
    let (mut agreed, mut refused, mut unknown) = (0, 0, Vec::new());
    for code in 1..=u16::MAX {
        let Some(definition) = crs_definitions::from_code(code) else { continue };
        let crs = Crs { epsg: Some(code.into()), ..Crs::default() };
        let Ok(earth) = Earth::of(&crs, 0.0) else {
            refused += 1;
            continue;
        };
        let words = Words(definition.proj4);
        // Heights are of another unit there, and scaled by us.
        let text: Vec<&str> = definition
            .proj4
            .split(' ')
            .filter(|word| !word.starts_with("+vunits") && !word.starts_with("+geoidgrids"))
            .collect();
        let Ok(source) = Proj::from_proj_string(&text.join(" ")) else {
            unknown.push(code);
            continue;
        };
        let middle = words.middle().unwrap();
        let north = words.number("lat_0").or(words.number("lat_ts")).unwrap_or(30.0).clamp(-88.0, 88.0);
        for (east, up) in [(0.3, -0.4), (-1.1, 0.9)] {
            let mut place = match earth.kind {
                Kind::Centred => (4_157_009.4, 670_910.4, 4_774_695.5),
                Kind::Degrees => (11.5 + east, 48.0 + up, 120.0),
                Kind::Map { .. } => {
                    let meridian = words.meridian().unwrap();
                    let mut place = ((middle + meridian + east).to_radians(), (north + up).to_radians(), 0.0);
                    let flat: Vec<&str> = text.iter().copied().filter(|word| !word.starts_with("+towgs84")).collect();
                    let flat = Proj::from_proj_string(&flat.join(" ")).unwrap();
                    let _ = transform(&degrees(definition.proj4), &flat, &mut place);
                    (place.0, place.1, 120.0)
                }
            };
            let scale = earth.units[1];
            let found = earth.centred([
                place.0,
                place.1,
                if let Kind::Centred = earth.kind { place.2 } else { place.2 / scale },
            ]);
            let found = found.unwrap_or_else(|words| panic!("{code} {place:?}: {words}"));
            if source.is_latlong() {
                place = (place.0.to_radians(), place.1.to_radians(), place.2);
            }
            transform(&source, &centred, &mut place).unwrap_or_else(|words| panic!("{code}: {words}"));
            let off = apart(found, [place.0, place.1, place.2]);
            assert!(off < 2e-3, "{code} {}: {found:?} {place:?}", definition.proj4);
        }
        agreed += 1;
    }
    println!("{agreed} {refused} {unknown:?}");
    assert!(agreed > 4500, "{agreed} systems, {refused} refused, {unknown:?} unknown to the other");
}

#[test]
fn a_frame_is_turned_back_by_its_transform() {
    let frame = Frame::about(KNOWN_PLACES[0].2);
    let place = KNOWN_PLACES[1].2;
    let [e, n, u] = frame.local(place);
    let m = frame.transform();
    let back: [f64; 3] = std::array::from_fn(|i| m[i] * e + m[4 + i] * n + m[8 + i] * u + m[12 + i]);
    assert!(apart(back, place) < 1e-8, "{back:?}");
    // 12.3 km east and 3.2 km north, where the Earth has fallen away by 12.7 m, from 126.5 m higher.
    assert!(
        (12_300.0..12_400.0).contains(&e) && (3_150.0..3_270.0).contains(&n) && (-140.0..-138.0).contains(&u),
        "{e} {n} {u}"
    );
    // 9 degrees east, 250 m high.
    assert!((frame.site.longitude - 9.0).abs() < 1e-9 && (frame.site.height - 250.0).abs() < 1e-3, "{}", frame.site);
    assert_eq!(frame.site.to_string(), "48.753013 N 9.000000 E, 250.000 m above the ellipsoid");
}

#[test]
fn heights_are_raised_along_the_normal() {
    for system in ["EPSG:25832", "EPSG:4978"] {
        let (_, place, _) = KNOWN_PLACES.into_iter().find(|(name, ..)| *name == system).unwrap();
        let crs = Crs::parse(system).unwrap();
        let [low, high] = [0.0, 45.25].map(|offset| Earth::of(&crs, offset).unwrap().centred(place).unwrap());
        let [e, n, u] = Frame::about(low).local(high);
        assert!(e.abs() < 1e-6 && n.abs() < 1e-6 && (u - 45.25).abs() < 1e-6, "{system}: {e} {n} {u}");
    }
}

#[test]
fn what_is_not_known_is_refused_with_the_way_out() {
    let site = Crs { name: Some("site".into()), ..Crs::default() };
    // NAD27, by grids; a datum without a shift; a sphere; a projection; gradians from Paris; a code that is none.
    let codes = [26_710, 2000, 2163, 3078, 4807, 65_000].map(|code| Crs { epsg: Some(code), ..Crs::default() });
    let none = Crs { unit: Some(crate::points::crs::KeyedUnit::Other), ..Crs::parse("EPSG:25832").unwrap() };
    for crs in codes.into_iter().chain([site, none]) {
        let words = Earth::of(&crs, 0.0).unwrap_err().to_string();
        assert!(words.contains("`crs` none"), "{words}");
    }
    assert!(
        Earth::of(&Crs::parse("EPSG:25832").unwrap(), f64::NAN).unwrap_err().to_string().contains("`height_offset`")
    );
    for (system, place) in [
        ("EPSG:25832", [1e9, 0.0, 0.0]),
        ("EPSG:4326", [5_403_000.0, 512_000.0, 0.0]),
        ("EPSG:3035", [1e12, 0.0, 0.0]),
        ("EPSG:3857", [f64::NAN; 3]),
    ] {
        let words = earth(system).centred(place).unwrap_err().to_string();
        assert!(words.contains("is no place of the reference system"), "{words}");
    }
}

#[test]
fn a_text_tells_a_shift_and_units_that_a_code_does_not() {
    let text = |shift: &str, unit: &str| {
        format!(
            r#"PROJCS["x",GEOGCS["y",DATUM["d",SPHEROID["s",6378206.4,294.9786982]{shift}]],UNIT["u",{unit}],AUTHORITY["EPSG","26710"]]"#
        )
    };
    let shifted = earth(&text(",TOWGS84[-8,160,176,0,0,0,0]", "1"));
    let feet = earth(&text(",TOWGS84[-8,160,176]", "0.304800609601"));
    let unmoved = earth(&text(",TOWGS84[0,0,0]", "1"));
    let place = [500_000.0, 4_200_000.0, 10.0];
    let there = shifted.centred(place).unwrap();
    let by: [f64; 3] = std::array::from_fn(|a| there[a] - unmoved.centred(place).unwrap()[a]);
    assert!(apart(by, [-8.0, 160.0, 176.0]) < 1e-6, "{by:?}");
    let foot = Unit::SurveyFoot.in_metres();
    assert!(apart(feet.centred(place.map(|c| c / foot)).unwrap(), there) < 1e-6);
}
