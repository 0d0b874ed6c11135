//! The task ids that releases of `rware` register, by default or on request.

use super::name::{COLUMN_HEIGHT, SENSOR_RANGE, SIZES};
use super::Config;

/// Whether `id`, the part after `rware-` for these parameters, is one of them. Without a version gymnasium takes the
/// newest.
pub(super) fn is_id(id: &str, config: &Config) -> bool {
    let Config { shelf_rows, shelf_columns, column_height, robots, requests, sensor_range, rules, .. } =
        *config;
    if !(1..=19).contains(&robots) || !(1..=15).contains(&column_height) || !(1..=5).contains(&sensor_range) {
        return false;
    }
    let version = format!("-{rules}");
    let id = id.strip_suffix(&version).unwrap_or(id);
    let sight = if sensor_range == SENSOR_RANGE { String::new() } else { format!("{sensor_range}s-") };

    let full = format!("{sight}{shelf_rows}x{shelf_columns}-{column_height}h-{robots}ag-{requests}req-indiv");
    if id.strip_prefix("nd-").unwrap_or(id) == full {
        return (1..=4).contains(&shelf_rows)
            && (3..=9).contains(&shelf_columns)
            && (1..=19).contains(&requests);
    }
    let Some((size, ..)) =
        SIZES.iter().find(|&&(_, rows, columns)| (rows, columns) == (shelf_rows, shelf_columns))
    else {
        return false;
    };
    let difficulty = match requests {
        _ if requests == robots => "",
        _ if requests == 2 * robots => "-easy",
        _ if requests == robots / 2 => "-hard",
        _ => return false,
    };
    let usual = column_height == COLUMN_HEIGHT && sensor_range == SENSOR_RANGE;
    id == format!("{sight}{size}-{column_height}h-{robots}ag{difficulty}")
        || usual && id == format!("{size}-{robots}ag{difficulty}")
}
