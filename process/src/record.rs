//! Records everything that a role sends and declares, for audits of the bus traffic.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use bus::{Bus, Record};
use proto::exit;

use crate::Failure;

/// Appends one JSON line for each record: `{"op", "key", "bytes", "hex"}`; declarations have no bytes.
pub(crate) fn record_to(bus: Arc<dyn Bus>, path: &Path) -> Result<Arc<dyn Bus>, Failure> {
    let file = File::create(path).map_err(|error| {
        Failure::new(exit::IO, format!("cannot create the record {}: {error}", path.display()))
    })?;
    let file = Mutex::new(file);
    Ok(bus::recorded(
        bus,
        Arc::new(move |record| {
            let (op, key, payload) = match &record {
                Record::Published { key, payload } => ("published", key, Some(payload)),
                Record::Asked { key, payload } => ("asked", key, Some(payload)),
                Record::Replied { key, payload } => ("replied", key, Some(payload)),
                Record::Subscribed { key } => ("subscribed", key, None),
                Record::Served { key } => ("served", key, None),
                Record::Announced { key } => ("announced", key, None),
                Record::Watched { key } => ("watched", key, None),
            };
            let mut line = serde_json::json!({ "op": op, "key": **key });
            if let Some(payload) = payload {
                let mut hex = String::with_capacity(2 * payload.len());
                for byte in payload {
                    // Writing to a String cannot fail.
                    let _ = write!(hex, "{byte:02x}");
                }
                line["bytes"] = payload.len().into();
                line["hex"] = hex.into();
            }
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            if let Err(error) = writeln!(file, "{line}") {
                tracing::warn!(%error, "the record of the traffic is incomplete");
            }
        }),
    ))
}
