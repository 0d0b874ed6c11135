//! The highways, shelf slots and goals of a warehouse (rware §2).

/// The floor plan. Cells are `(x, y)`, x to the right, y downwards, both from 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    pub width: u16,
    pub height: u16,
    /// In the order in which deliveries are checked.
    pub goals: [(u16, u16); 2],
    /// The slots of the shelves 1, 2, …: all cells that are not highways, row by row.
    pub slots: Vec<(u16, u16)>,
    /// Row by row.
    highway: Vec<bool>,
}

impl Layout {
    /// Blocks of shelves two wide and `column_height` high, with highways around them and a lane of two cells in
    /// front of the goals that leads through the last row of blocks. `shelf_columns` is odd, all are at least 1.
    pub(super) fn new(shelf_rows: u16, shelf_columns: u16, column_height: u16) -> Layout {
        let (width, height) = sides(shelf_rows, shelf_columns, column_height);
        let (width, height) = (width as u16, height as u16);
        let middle = [width / 2 - 1, width / 2];
        let lane_top = height - (column_height + 2);
        let is_highway = |x: u16, y: u16| {
            x.is_multiple_of(3)
                || y.is_multiple_of(column_height + 1)
                || y == height - 1
                || (y >= lane_top && middle.contains(&x))
        };
        let cells = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Layout {
            width,
            height,
            goals: middle.map(|x| (x, height - 1)),
            slots: cells().filter(|&(x, y)| !is_highway(x, y)).collect(),
            highway: cells().map(|(x, y)| is_highway(x, y)).collect(),
        }
    }

    pub fn is_highway(&self, x: u16, y: u16) -> bool {
        self.highway[usize::from(y) * usize::from(self.width) + usize::from(x)]
    }
}

/// Width and height of the grid.
pub(super) fn sides(shelf_rows: u16, shelf_columns: u16, column_height: u16) -> (u64, u64) {
    let [rows, columns, high] = [shelf_rows, shelf_columns, column_height].map(u64::from);
    (3 * columns + 1, (high + 1) * rows + 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(layout: &Layout) -> Vec<String> {
        let cell = |x, y| match layout.is_highway(x, y) {
            _ if layout.goals.contains(&(x, y)) => 'G',
            true => '.',
            false => 'x',
        };
        (0..layout.height).map(|y| (0..layout.width).map(|x| cell(x, y)).collect()).collect()
    }

    #[test]
    fn tiny_and_small_are_drawn_as_in_the_spec() {
        let (row, block, last, goals) = ("..........", ".xx.xx.xx.", ".xx....xx.", "....GG....");
        let tiny = [&[row][..], &[last; 8], &[row, goals]].concat();
        assert_eq!(map(&Layout::new(1, 3, 8)), tiny);
        let small = [&[row][..], &[block; 8], &[row], &[last; 8], &[row, goals]].concat();
        assert_eq!(map(&Layout::new(2, 3, 8)), small);
    }

    #[test]
    fn the_lane_to_the_goals_takes_two_columns_of_the_last_blocks() {
        let layout = Layout::new(2, 5, 2);
        let expected = [
            "................",
            ".xx.xx.xx.xx.xx.",
            ".xx.xx.xx.xx.xx.",
            "................",
            ".xx.xx....xx.xx.",
            ".xx.xx....xx.xx.",
            "................",
            ".......GG.......",
        ];
        assert_eq!(map(&layout), expected);
        assert_eq!(layout.goals, [(7, 7), (8, 7)]);
        assert_eq!((layout.slots[0], layout.slots[10], layout.slots[20]), ((1, 1), (1, 2), (1, 4)));
    }

    #[test]
    fn named_sizes_have_the_shelves_of_the_reference() {
        for (rows, columns, shelves) in [(1, 3, 32), (2, 3, 80), (2, 5, 144), (3, 5, 224)] {
            assert_eq!(Layout::new(rows, columns, 8).slots.len(), shelves);
        }
    }
}
