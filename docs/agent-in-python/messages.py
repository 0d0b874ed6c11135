"""The messages of docs/protocol.md as bytes: what an agent sends, and what it reads."""

import math
import struct
from types import SimpleNamespace

WIRE_VERSION = 2
OBSERVE, ACT, JOIN, WELCOME, RATES, RATES_QUERY, PROGRESS, METRICS = range(1, 9)


class WireError(Exception):
    """These bytes are not the message that belongs here."""


def varint(number):
    if number <= 250:
        return bytes([number])
    for marker, form in ((251, "<H"), (252, "<I"), (253, "<Q")):
        if number < 1 << 8 * struct.calcsize(form):
            return bytes([marker]) + struct.pack(form, number)
    raise ValueError(f"{number} has more than 64 bits")


class Reader:
    """Reads a control message from its third byte on."""

    def __init__(self, content, tag, most):
        if len(content) > most:
            raise WireError(f"{len(content)} bytes, at most {most} are allowed")
        self.content, self.at = content, 2
        check_frame(content, tag)

    def take(self, length):
        if len(self.content) - self.at < length:
            raise WireError("the message is cut off")
        self.at += length
        return self.content[self.at - length:self.at]

    def varint(self):
        first = self.take(1)[0]
        if first <= 250:
            return first
        if first > 253:
            raise WireError(f"a number begins with {first}")
        return int.from_bytes(self.take({251: 2, 252: 4, 253: 8}[first]), "little")

    def f64(self):
        return struct.unpack("<d", self.take(8))[0]

    def list(self, read):
        # A hostile length ends at the end of the message.
        return [read() for _ in range(min(self.varint(), len(self.content) + 1))]

    def end(self):
        if self.at < len(self.content):
            raise WireError(f"{len(self.content) - self.at} bytes too many")


def check_frame(content, tag):
    if len(content) < 2:
        raise WireError("shorter than a frame")
    if content[0] != WIRE_VERSION:
        raise WireError(f"wire version {content[0]}, expected {WIRE_VERSION}: use the version that fits")
    if content[1] != tag:
        raise WireError(f"tag {content[1]}, expected {tag}")


def join(config_digest, nonce, rounds):
    rounds = varint(len(rounds)) + b"".join(map(varint, rounds))
    return bytes([WIRE_VERSION, JOIN]) + config_digest + varint(nonce) + rounds


REFUSALS = {
    0: "it speaks another wire version than the env-server",
    1: "it has another config.toml than the env-server",
    2: "another living process has this seat",
    3: "the team has no such seat",
    4: "the request to join was not understood",
    5: "the run is ending",
    6: "no checkpoint is held by every process, and a start from the beginning would throw work away",
}


def welcome(content):
    """A seat and None, or None and a refusal."""
    # The first bytes of this refusal are the same in every version: only so does it reach another one.
    if content[1:4] == bytes([WELCOME, 1, 0]):
        return None, SimpleNamespace(closing=False, text=REFUSALS[0])
    read = Reader(content, WELCOME, 1024)
    if (variant := read.varint()) > 1:
        raise WireError(f"a welcome of variant {variant}")
    if variant == 1:
        reason = read.varint()
        text = REFUSALS.get(reason, f"reason {reason}, which this agent does not know")
        return None, SimpleNamespace(closing=reason == 5, text=text)
    names = "epoch round t_env agents obs_size n_actions copies test_episodes episode_limit"
    seat = SimpleNamespace(**{name: read.varint() for name in names.split()})
    read.end()
    return seat, None


def rates(content, agents):
    read = Reader(content, RATES, 67_612)
    found = SimpleNamespace(first=read.varint(), until=read.varint(), fast_agent=read.varint(),
                            rates=read.list(read.f64), levels=read.list(lambda: read.take(1)[0]))
    read.end()
    if not all(math.isfinite(rate) and rate >= 0 for rate in found.rates):
        raise WireError("a rate is no finite number from 0")
    if found.first >= found.until or found.fast_agent >= agents or len(found.levels) != agents \
            or max(found.levels) >= len(found.rates):
        raise WireError("a schedule that cannot be followed")
    return found


def rates_query(update_call):
    return bytes([WIRE_VERSION, RATES_QUERY]) + varint(update_call)


def progress(update_calls, finished=False):
    return bytes([WIRE_VERSION, PROGRESS]) + varint(update_calls) + bytes([finished])


def metrics(t_env, update_calls, scalars):
    parts = [bytes([WIRE_VERSION, METRICS]), varint(t_env), varint(update_calls), varint(len(scalars))]
    for name, value in scalars.items():
        parts += [varint(len(name.encode())), name.encode(), struct.pack("<d", value)]
    return b"".join(parts)


def act(tick, actions):
    header = struct.pack("<BBBxIQIHxx", WIRE_VERSION, ACT, tick.mode, tick.epoch, tick.round, tick.tick, len(actions))
    return header + struct.pack(f"<{len(actions)}H", *actions)


class Observe:
    """A tick. `id` names it; a list has an entry for each row."""

    def __init__(self, content):
        check_frame(content, OBSERVE)
        if len(content) < 40:
            raise WireError("shorter than its header")
        (self.mode, zero, self.epoch, self.round, self.tick, rows, self.obs_size, self.n_actions, zeros,
         self.t_env) = struct.unpack_from("<xxBBIQIHHH6sQ", content)
        self.id = (self.mode, self.epoch, self.round, self.tick)
        padding = -3 * rows % 4
        form = f"<{rows}H{rows}B{padding}s{rows}f{rows * self.obs_size}f{rows * self.n_actions}B"
        if len(content) != 40 + struct.calcsize(form):
            raise WireError("its length does not fit its header")
        values = struct.unpack_from(form, content, 40)
        self.copies, self.ends = values[:rows], values[rows:2 * rows]
        at = 2 * rows + 1
        self.rewards, at = values[at:at + rows], at + rows
        self.obs = [values[at + k * self.obs_size:at + (k + 1) * self.obs_size] for k in range(rows)]
        at += rows * self.obs_size
        self.available = [values[at + k * self.n_actions:at + (k + 1) * self.n_actions] for k in range(rows)]
        self.check(zero == 0 and not any(zeros) and not any(values[2 * rows]))

    def check(self, zeros_are_zero):
        if not zeros_are_zero or self.mode > 3 or (self.mode > 1) == bool(self.copies):
            raise WireError("its header says something impossible")
        if any(before >= after for before, after in zip(self.copies, self.copies[1:])):
            raise WireError("the copies are not strictly increasing")
        if not all(map(math.isfinite, (*self.rewards, *(number for row in self.obs for number in row)))):
            raise WireError("a reward or an observation is not finite")
        if any(end > 2 for end in self.ends) or self.tick == 0 and (any(self.ends) or any(self.rewards)):
            raise WireError("an end or a reward that cannot be")
        for end, available in zip(self.ends, self.available):
            if any(flag > 1 for flag in available) or end == 0 and not any(available):
                raise WireError("a running row without an available action")
