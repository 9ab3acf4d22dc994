//! `gonio-eval folds` on the small world.

use super::bench::{Place, run};

#[test]
fn errors_cover_the_left_out_materials_and_kinds() {
    let place = Place::new();
    let small = [
        "folds",
        "--folds",
        "2",
        "--views",
        "1",
        "--group-materials",
        "8",
        "--steps",
        "4",
        "--batch",
        "16",
        "--entries",
        "60",
        "--dimensions",
        "3",
        "--candidates",
        "400",
    ];
    let output = run(place.command(&small).args(["--without", "metal"]));
    let table = String::from_utf8(output.stdout).unwrap();
    let cells = |group: &str| -> Vec<f64> {
        let row = table.lines().find(|l| l.starts_with(&format!("| {group} "))).unwrap_or_else(|| panic!("{table}"));
        let number = |cell: &str| cell.split([' ', '%']).find(|w| !w.is_empty()).unwrap().parse().unwrap();
        row.trim_matches('|').split('|').skip(1).map(|c| number(c.trim())).collect()
    };
    // Every training material and light is left out once. Each kind has a dozen draws for each
    // light. Each subject is photographed with and without camera effects.
    for camera in ["clean", "camera"] {
        for (kind, photographs) in [("measured", 12.0), ("metal", 36.0)] {
            let row = cells(&format!("{kind} {camera}"));
            assert_eq!((row.len(), row[0]), (8, photographs), "{table}");
            assert!(row[1] > 0.0 && row[1] < 1.0 && row[2] > 0.0 && row[3] > 0.0, "{table}");
            // The number of the last column is the share of the 50 % intervals.
            assert!((0.0..=100.0).contains(&row[7]), "{table}");
        }
    }
    assert!(table.contains("hardest"), "{table}");

    let refused = place.command(&["folds", "--folds", "1"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--folds must be at least 2"));
}
