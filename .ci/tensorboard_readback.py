#!/usr/bin/env python3
"""Reads a run's TensorBoard files with TensorBoard's own reader and compares every scalar with metrics.jsonl.

usage: tensorboard_readback.py RUN_FOLDER        (needs: pip install tensorboard)

Ends with 1 and a message if anything differs, is missing, or if there is nothing to compare.
"""

import json
import struct
import sys
from collections import defaultdict
from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

FIXED_COLUMNS = ("t_env", "update_calls", "rounds")


def single(value):
    """The value at single precision, as TensorBoard stores it; None for what is not finite."""
    if value is None:
        return None
    try:
        value = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:  # Finite in double precision only.
        return None
    return value if abs(value) < float("inf") else None  # NaN compares as false.


def expected(metrics):
    scalars = defaultdict(list)
    for line in metrics.read_text().splitlines():
        row = json.loads(line)
        for name, value in row.items():
            if name not in FIXED_COLUMNS:
                scalars[name].append((row["t_env"], single(value)))
    return scalars


def found(folder):
    events = EventAccumulator(str(folder), size_guidance={"scalars": 0}, purge_orphaned_data=False).Reload()
    return {tag: [(e.step, single(e.value)) for e in events.Scalars(tag)] for tag in events.Tags()["scalars"]}


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    run = Path(sys.argv[1])
    with_rows = {path.parent.name for path in run.glob("*/metrics.jsonl") if path.stat().st_size > 0}
    with_events = {path.name for path in run.glob("tensorboard/*") if path.is_dir()}
    compared = 0
    for role in sorted(with_rows | with_events):
        metrics = run / role / "metrics.jsonl"
        rows = expected(metrics) if metrics.exists() else {}
        events = found(run / "tensorboard" / role) if role in with_events else {}
        if rows.keys() != events.keys():
            sys.exit(f"{role}: metrics.jsonl has {sorted(rows)}, TensorBoard reads {sorted(events)}")
        for tag in rows:
            if len(rows[tag]) != len(events[tag]):
                sys.exit(f"{role}: {tag} has {len(rows[tag])} rows, TensorBoard reads {len(events[tag])}")
            for i, (row, event) in enumerate(zip(rows[tag], events[tag])):
                if row != event:
                    sys.exit(f"{role}: {tag}, value {i + 1}: metrics.jsonl has {row}, TensorBoard reads {event}")
            compared += len(rows[tag])
    if compared == 0:
        sys.exit(f"nothing to compare in {run}: no role has both metric rows and TensorBoard files")
    print(f"{compared} scalars of {len(with_rows)} roles agree")


if __name__ == "__main__":
    main()
