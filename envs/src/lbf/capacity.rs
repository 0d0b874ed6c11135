//! How many foods fit on a grid at once.
//!
//! Two foods are three or more steps apart, and none lies on the border (lbf §3, rule 4). So every food occupies a
//! plus of five cells; pluses lie within the grid and do not overlap.

use std::collections::HashMap;

/// Longest side of an interior that is searched: it takes some hundredths of a second, and each further column half
/// as much again.
const EXACT_SIDE: u32 = 13;

/// `None` if `foods` fit on an empty grid (or, on a large grid, may fit). Otherwise an upper limit below `foods`.
pub(super) fn shortfall(rows: u16, cols: u16, foods: u16) -> Option<u32> {
    let (height, width) = (u32::from(rows.max(cols)) - 2, rows.min(cols) - 2);
    let interior = height * u32::from(width);
    let foods = u32::from(foods);
    // Pluses tile the plane with one centre in five cells. One of the five shifts of this pattern has at least this
    // many centres in the interior.
    if foods <= interior.div_ceil(5) {
        return None;
    }
    let most = if height <= EXACT_SIDE {
        most_centres(height, width)
    } else {
        // No plus contains a corner.
        (u32::from(rows) * u32::from(cols) - 4) / 5
    };
    (most < foods).then_some(most)
}

/// The largest set of cells of a `height` by `width` block that are three or more steps apart, row by row over
/// the contents of the last two rows.
fn most_centres(height: u32, width: u16) -> u32 {
    let rows: Vec<u32> =
        (0..1 << width).filter(|row| row & (row << 1) == 0 && row & (row << 2) == 0).collect();
    let mut best = HashMap::from([((0, 0), 0)]);
    for _ in 0..height {
        let mut next = HashMap::with_capacity(best.len());
        for (&(above2, above1), &count) in &best {
            let taken = above2 | above1 | (above1 << 1) | (above1 >> 1);
            for &row in rows.iter().filter(|&row| row & taken == 0) {
                let entry = next.entry((above1, row)).or_insert(0);
                *entry = (count + row.count_ones()).max(*entry);
            }
        }
        best = next;
    }
    best.into_values().max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tries every subset of the interior.
    fn by_exhaustion(height: u32, width: u32) -> u32 {
        let cells: Vec<(i32, i32)> =
            (0..height * width).map(|k| ((k / width) as i32, (k % width) as i32)).collect();
        let fits = |set: u32| {
            let chosen: Vec<_> = (0..cells.len()).filter(|k| set >> k & 1 == 1).map(|k| cells[k]).collect();
            chosen
                .iter()
                .enumerate()
                .all(|(k, a)| chosen[..k].iter().all(|b| (a.0 - b.0).abs() + (a.1 - b.1).abs() > 2))
        };
        (0..1 << cells.len()).filter(|&set| fits(set)).map(u32::count_ones).max().unwrap()
    }

    #[test]
    fn the_search_agrees_with_trying_everything() {
        for (height, width) in [(1, 1), (2, 2), (3, 3), (4, 3), (4, 4), (5, 3), (7, 2)] {
            assert_eq!(most_centres(height, width as u16), by_exhaustion(height, width), "{height}x{width}");
        }
    }

    #[test]
    fn a_five_by_five_grid_holds_two_foods() {
        assert_eq!(shortfall(5, 5, 2), None);
        assert_eq!(shortfall(5, 5, 3), Some(2));
        assert_eq!(shortfall(5, 5, 9), Some(2));
        assert_eq!(shortfall(3, 3, 1), None);
        assert_eq!(shortfall(3, 3, 2), Some(1));
    }

    #[test]
    fn a_large_grid_is_refused_only_what_area_forbids() {
        assert_eq!(shortfall(100, 100, 1921), None); // the pattern alone fits this many
        assert_eq!(shortfall(100, 100, 1999), None); // perhaps
        assert_eq!(shortfall(100, 100, 2000), Some(1999));
    }

    #[test]
    fn the_pattern_bound_never_promises_more_than_the_search_finds() {
        for rows in 3..=12 {
            for cols in 3..=rows {
                let interior = u32::from(rows - 2) * u32::from(cols - 2);
                assert!(interior.div_ceil(5) <= most_centres(u32::from(rows - 2), cols - 2), "{rows}x{cols}");
            }
        }
    }
}
