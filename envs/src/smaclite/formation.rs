//! How a group of units stands at the start (smaclite §3).

use super::map::Side;

/// Between two units of a row, and between two rows.
const GAP: f64 = 0.05;

/// The places of a group of units with these sizes around a centre, row by row.
pub(super) fn places(side: Side, centre: [f64; 2], sizes: &[f64]) -> Vec<[f32; 2]> {
    let m = match side {
        Side::Allies => 1.0,
        Side::Enemies => -1.0,
    };
    let per_row = (1..).find(|row| row * row >= sizes.len()).expect("there is a root");
    let rows: Vec<&[f64]> = sizes.chunks(per_row.max(1)).collect();
    let radius_of = |row: &[f64]| row.iter().fold(0.0_f64, |most, size| most.max(size / 2.0));
    let radii: f64 = rows.iter().map(|row| radius_of(row)).sum();
    let height = 2.0 * radii + GAP * (per_row as f64 - 1.0);
    let width = rows.iter().map(|row| row.iter().sum()).fold(0.0_f64, f64::max);

    let mut places = Vec::new();
    let (mut y, mut radius_before) = (centre[1] - m * height / 2.0, 0.0);
    for row in rows {
        let radius = radius_of(row);
        y += m * (radius_before + radius);
        radius_before = radius;
        let (mut x, mut before) = (centre[0] - m * width / 2.0, 0.0);
        for size in row {
            x += m * (before + size / 2.0);
            before = size / 2.0;
            places.push([x as f32, y as f32]);
            x += GAP * m;
        }
        y += GAP * m;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_places(side: Side, centre: [f64; 2], sizes: &[f64], expected: &[[f32; 2]]) {
        let found = places(side, centre, sizes);
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            for axis in 0..2 {
                assert!((found[axis] - expected[axis]).abs() < 2e-6, "{found:?}, not {expected:?}");
            }
        }
    }

    #[test]
    fn groups_stand_where_the_reference_puts_them() {
        let (stalker, zealot, marine, marauder, medivac) = (1.25, 1.0, 0.75, 1.125, 1.5);
        let sizes = [[stalker; 3].as_slice(), &[zealot; 5]].concat();
        let allies = [
            [7.75, 14.95],
            [9.05, 14.95],
            [10.35, 14.95],
            [7.625, 16.125],
            [8.675, 16.125],
            [9.725, 16.125],
            [7.625, 17.175],
            [8.675, 17.175],
        ];
        assert_places(Side::Allies, [9.0, 16.0], &sizes, &allies);
        assert_places(Side::Enemies, [23.0, 16.0], &sizes, &allies.map(|[x, y]| [32.0 - x, 32.0 - y]));
        let five = [[24.0, 16.55], [22.95, 16.55], [21.9, 16.55], [24.0, 15.5], [22.95, 15.5]];
        assert_places(Side::Enemies, [23.0, 16.0], &[zealot; 5], &five);
        let sizes = [[medivac].as_slice(), &[marine; 8], &[marauder; 3]].concat();
        let mmm2 = [
            [24.3125, 17.0125],
            [23.1375, 17.0125],
            [22.3375, 17.0125],
            [21.5375, 17.0125],
            [24.6875, 15.8375],
            [23.8875, 15.8375],
            [23.0875, 15.8375],
            [22.2875, 15.8375],
            [24.6875, 14.85],
            [23.7, 14.85],
            [22.525, 14.85],
            [21.35, 14.85],
        ];
        assert_places(Side::Enemies, [23.0, 16.0], &sizes, &mmm2);
    }
}
