#!/usr/bin/env python3
"""Turns EPyMARL's opponents into files for `rondo train --opponent FILE`.

EPyMARL keeps them as `src/envs/pretrained/prey_params.pt` (Tag) and `adv_params.pt` (Adversary), in the form that
torch wrote before version 1.6: a sequence of pickles, then the raw numbers. Only the standard library is needed; the
unpickler knows the few names that such a file contains and refuses every other, so a foreign file runs no code.

    from_epymarl.py prey prey_params.pt prey.safetensors
    from_epymarl.py adversary adv_params.pt adversary.safetensors
"""

import argparse
import hashlib
import json
import pickle
import struct
import sys
from collections import OrderedDict
from pathlib import Path

MAGIC = 0x1950A86A20F9469CFC6C
PROTOCOL = 1001
# Name in torch: bytes of a number, and its code for `struct`.
NUMBERS = {"FloatStorage": (4, "f"), "DoubleStorage": (8, "d"), "LongStorage": (8, "q"), "IntStorage": (4, "i")}
# Whose network of the saved team plays, and the numbers it sees.
ROLES = {"prey": (-1, 14), "adversary": (0, 8)}
LAYERS = ["fc1", "fc2", "fc3"]
ACTIONS = 5


class Refused(Exception):
    """The file is not what it should be."""


class Tensor:
    """A view of a storage: where it begins, its shape and its steps, in numbers."""

    def __init__(self, storage, offset, shape, strides, *_):
        self.storage, self.offset, self.shape, self.strides = storage, offset, tuple(shape), tuple(strides)

    def numbers(self):
        """All numbers in row-major order."""
        places = [self.offset]
        for size, stride in zip(self.shape, self.strides):
            places = [place + k * stride for place in places for k in range(size)]
        values = self.storage["values"]
        if any(not 0 <= place < len(values) for place in places):
            raise Refused("a tensor reaches beyond its numbers")
        return [values[place] for place in places]


class Plain(pickle.Unpickler):
    """Reads numbers, texts and containers, nothing else."""

    def find_class(self, module, name):
        raise Refused(f"it holds a `{module}.{name}` where plain values are expected")


class Reader(Plain):
    """Reads nests of tensors and containers, nothing else."""

    def __init__(self, file):
        super().__init__(file)
        self.storages = {}

    def find_class(self, module, name):
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if module == "torch._utils" and name in ("_rebuild_tensor", "_rebuild_tensor_v2"):
            return Tensor
        if module == "torch" and name in NUMBERS:
            return name
        raise Refused(f"it holds a `{module}.{name}`, which no saved network needs")

    def persistent_load(self, reference):
        kind, number, key, _place, count, view = reference
        if kind != "storage" or view is not None or number not in NUMBERS:
            raise Refused(f"it refers to something unexpected: {reference!r}")
        return self.storages.setdefault(key, {"number": number, "count": count, "values": None})


def read(file):
    """What the checkpoint holds, with all numbers in place."""
    if Plain(file).load() != MAGIC or Plain(file).load() != PROTOCOL:
        raise Refused("expected a file that torch wrote before version 1.6")
    Plain(file).load()
    reader = Reader(file)
    content = reader.load()
    for key in Plain(file).load():
        storage = reader.storages.get(key)
        if storage is None:
            raise Refused(f"numbers `{key}` belong to nothing")
        (count,) = struct.unpack("<q", file.read(8))
        size, code = NUMBERS[storage["number"]]
        raw = file.read(size * count)
        if count != storage["count"] or len(raw) != size * count:
            raise Refused(f"expected {storage['count']} numbers in `{key}`, found {len(raw) // size}")
        storage["values"] = struct.unpack(f"<{count}{code}", raw)
    if file.read(1):
        raise Refused("something follows the numbers")
    return content


def network(content, role):
    """The acting network of a role: name to tensor, with the sizes checked."""
    index, inputs = ROLES[role]
    try:
        policy = content["agent_params"][index]["policy"]
    except (KeyError, IndexError, TypeError) as error:
        raise Refused(f"expected the policy of an agent under `agent_params`, found none ({error})") from error
    names = [f"in_fn.{part}" for part in ("weight", "bias", "running_mean", "running_var")]
    names += [f"{layer}.{part}" for layer in LAYERS for part in ("weight", "bias")]
    missing = [name for name in names if name not in policy]
    if missing:
        raise Refused(f"the policy has no {', '.join(missing)}")
    tensors = {name: policy[name] for name in names}
    first, last = tensors["fc1.weight"].shape, tensors["fc3.weight"].shape
    if first[1:] != (inputs,) or last[:1] != (ACTIONS,):
        raise Refused(f"expected a network from {inputs} numbers to {ACTIONS} scores, found {first} to {last}")
    return tensors


def safetensors(tensors, provenance):
    """The bytes of a safetensors file."""
    header, body = {"__metadata__": provenance}, b""
    for name, tensor in sorted(tensors.items()):
        raw = struct.pack(f"<{len(tensor.numbers())}f", *tensor.numbers())
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [len(body), len(body) + len(raw)]}
        body += raw
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<Q", len(text)) + text + body


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("role", choices=sorted(ROLES))
    arguments.add_argument("checkpoint", type=Path)
    arguments.add_argument("out", type=Path)
    chosen = arguments.parse_args()
    try:
        with chosen.checkpoint.open("rb") as file:
            tensors = network(read(file), chosen.role)
    except (Refused, pickle.UnpicklingError, EOFError, struct.error) as error:
        sys.exit(f"error: {chosen.checkpoint} cannot be used: {error}")
    digest = hashlib.sha256(chosen.checkpoint.read_bytes()).hexdigest()
    provenance = {
        "source": f"EPyMARL src/envs/pretrained/{chosen.checkpoint.name}",
        "source_sha256": digest,
        "licence": "Apache-2.0",
    }
    with chosen.out.open("xb") as file:
        file.write(safetensors(tensors, provenance))
    print(f"{chosen.out}: {sum(len(tensor.numbers()) for tensor in tensors.values())} numbers")


if __name__ == "__main__":
    main()
