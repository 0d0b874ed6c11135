#!/usr/bin/env python3
"""One agent of a Rondo run in Python, written from docs/protocol.md alone.

    python3 -m pip install -r requirements.txt
    python3 agent.py --id 1 --config config.toml --out runs/mine --connect WORLD --connect COORDINATOR

It does all that the protocol asks of an agent: it joins, acts, learns, tests, reports, saves, leaves when it is
told to, and goes on later from its checkpoints. What it learns is simple: a linear policy by REINFORCE, one step
of gradient ascent in each update call. Put another class in the place of `Learner` to try something better.
Python 3.11 or newer; exit codes as in the protocol.
"""

import argparse
import collections
import json
import math
import os
import queue
import random
import secrets
import shutil
import signal
import struct
import sys
import time
import tomllib
from array import array
from pathlib import Path

import zenoh
from blake3 import blake3

from messages import Observe, WireError, act, join, metrics, progress, rates, rates_query, welcome

DONE, USAGE, IO, AGAIN, CONFIG = 0, 64, 74, 75, 78
TRAIN, TEST, FINISHED, STOPPED = range(4)
# Seconds: between two queries; between two without a server; before a lost env-server is given up.
ASK_AGAIN, PAUSE, GRACE = 5, 0.05, 5
KEEP = 2  # checkpoints, because other processes may not have the newest


class Leave(Exception):
    """The end of this process: an exit code, and a text for the person who started it, if there is a problem."""

    def __init__(self, code, text=""):
        super().__init__(text)
        self.code = code


class Learner:
    """A linear softmax policy, improved by REINFORCE with the batch's mean return as the baseline."""

    def __init__(self, obs_size, n_actions, gamma):
        self.inputs, self.n_actions, self.gamma = obs_size + 1, n_actions, gamma
        # Of 32 bits, so that a checkpoint holds them exactly.
        self.weights = array("f", bytes(4 * self.inputs * n_actions))

    def policy(self, x, available):
        rows = (self.weights[a * self.inputs:(a + 1) * self.inputs] for a in range(self.n_actions))
        logits = [sum(map(float.__mul__, row, x)) for row in rows]
        top = max(value for value, ok in zip(logits, available) if ok)
        raised = [math.exp(value - top) if ok else 0.0 for value, ok in zip(logits, available)]
        total = sum(raised)
        return [value / total for value in raised]

    def act(self, x, available, chance):
        return chance.choices(range(self.n_actions), self.policy(x, available))[0]

    def update(self, episodes, rate):
        """One update call. Each episode is a list of [inputs, available, action, reward]."""
        samples = []
        for episode in episodes:
            future = 0.0
            for x, available, action, reward in reversed(episode):
                future = reward + self.gamma * future
                samples.append((x, available, action, future))
        baseline = sum(sample[3] for sample in samples) / len(samples)
        gradient, loss, entropy = [0.0] * len(self.weights), 0.0, 0.0
        for x, available, action, future in samples:
            probabilities = self.policy(x, available)
            loss -= math.log(probabilities[action]) * (future - baseline) / len(samples)
            entropy -= sum(p * math.log(p) for p in probabilities if p > 0) / len(samples)
            for a, p in enumerate(probabilities):
                factor = (future - baseline) * ((a == action) - p) / len(episodes)
                for k, value in enumerate(x, a * self.inputs):
                    gradient[k] += factor * value
        # At rate 0 this changes nothing, and is an update call all the same.
        self.weights = array("f", (w + rate * g for w, g in zip(self.weights, gradient)))
        return {"actor_loss": loss, "entropy": entropy, "lr": rate}


class Folder:
    """`agent-i/` in the run folder: checkpoints that are whole or not there, and the rows of metrics.jsonl."""

    def __init__(self, run, agent, config):
        run.mkdir(mode=0o700, parents=True, exist_ok=True)
        copy = run / "config.toml"
        if not copy.exists():
            copy.write_bytes(config)
        elif copy.read_bytes() != config:
            raise Leave(CONFIG, f"{run} belongs to a run with another configuration; choose another --out")
        self.path = run / f"agent-{agent}"
        self.checkpoints = self.path / "checkpoints"
        self.begun = self.path / "config.toml"
        self.checkpoints.mkdir(parents=True, exist_ok=True)
        self.rows = open(self.path / "metrics.jsonl", "ab")

    def rounds(self):
        """The rounds whose checkpoint is whole, ascending."""
        found = (int(path.name[6:]) for path in self.checkpoints.glob("round-" + 12 * "[0-9]"))
        return sorted(round for round in found if self._read(self._of(round)))

    def held_rounds(self):
        """The rounds that this agent can start from: 0 too, if it had a seat in this run before."""
        return [0] * self.begun.exists() + self.rounds()

    def begin(self, config):
        """Notes that this agent has had a seat, and with which configuration."""
        self.begun.write_bytes(config)

    def _read(self, path):
        """State and weights, or None if a file is missing or not the one that the manifest describes."""
        try:
            manifest = json.loads((path / "manifest.json").read_bytes())["files"]
            files = {name: (path / name).read_bytes() for name in ("state.bin", "weights.safetensors")}
        except (OSError, ValueError, KeyError):
            return None
        whole = all(describe(content) == manifest.get(name) for name, content in files.items())
        return (json.loads(files["state.bin"]), files["weights.safetensors"]) if whole else None

    def go_on_from(self, round):
        """The state and the weights of a round; None at round 0. What is later is set aside, not deleted."""
        found = self._read(self._of(round)) if round else None
        if round and not found:
            raise Leave(CONFIG, f"the run goes on from round {round}, of which {self.path} has no checkpoint")
        aside = self.path / "set-aside"
        for later in (held for held in self.rounds() if held > round):
            aside.mkdir(exist_ok=True)
            shutil.rmtree(aside / self._of(later).name, ignore_errors=True)
            self._of(later).rename(aside / self._of(later).name)
        kept, there = found[0]["bytes"] if found else 0, self.rows.seek(0, os.SEEK_END)
        if kept > there:
            raise Leave(CONFIG, f"{self.rows.name} lacks rows that the checkpoint of round {round} counts on")
        if aside.exists():
            shutil.copy(self.rows.name, aside)
        self.rows.truncate(kept)
        return found

    def save(self, state, weights, shape):
        header = json.dumps({"policy": {"dtype": "F32", "shape": shape, "data_offsets": [0, len(weights)]}})
        header = header.encode().ljust(-(-len(header) // 8) * 8)
        os.fsync(self.rows.fileno())
        state = {**state, "bytes": self.rows.seek(0, os.SEEK_END)}
        files = {
            "state.bin": json.dumps(state).encode(),
            "weights.safetensors": struct.pack("<Q", len(header)) + header + weights,
        }
        manifest = {"format_version": 1, "round": state["round"],
                    "files": {name: describe(content) for name, content in files.items()}}
        path = self._of(state["round"])
        unfinished = path.with_name(".writing-" + path.name)
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir()
        for name, content in {**files, "manifest.json": json.dumps(manifest).encode()}.items():
            with open(unfinished / name, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        shutil.rmtree(path, ignore_errors=True)
        unfinished.rename(path)
        for old in self.rounds()[:-KEEP]:
            shutil.rmtree(self._of(old))

    def log(self, t_env, update_calls, scalars):
        row = {"t_env": t_env, "update_calls": update_calls, **scalars}
        self.rows.write(json.dumps(row, separators=(",", ":")).encode() + b"\n")
        self.rows.flush()

    def _of(self, round):
        return self.checkpoints / f"round-{round:012}"


def describe(content):
    return {"bytes": len(content), "blake3": blake3(content).hexdigest()}


class Agent:
    def __init__(self, options):
        try:
            config = options.config.read_bytes()
            self.config_bytes, self.config = config, tomllib.loads(config.decode())
        except (OSError, ValueError) as error:
            raise Leave(CONFIG, f"cannot read {options.config}: {error}") from None
        self.id, self.wait = options.id, options.wait
        self.folder = Folder(options.out, options.id, config)
        self.question = join(blake3(config).digest(), secrets.randbits(64), self.folder.held_rounds())
        self.endpoints = options.connect
        # What arrives, as (kind, content). It takes entries from zenoh's threads and from signal handlers.
        self.inbox = queue.SimpleQueue()
        self.held = collections.deque()
        self.ignored = 0
        self.schedule = []
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2):
            if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
                signal.signal(number, lambda *_: self.inbox.put(("stop", None)))

    def run(self):
        try:
            session = zenoh.open(self.bus())
        except zenoh.ZError as error:
            raise Leave(AGAIN, f"cannot reach {' and '.join(self.endpoints)}: {error}") from None
        # The session is closed on every way out, or its threads would keep process and seat alive.
        with session:
            self.session = session
            self.take_seat()
            try:
                self.live()
            except Leave:  # always between two rounds, or within one that nothing was learned from yet
                self.save()
                raise

    def bus(self):
        settings = {
            "mode": "peer",
            "listen": {"endpoints": []},
            "connect": {"endpoints": self.endpoints, "timeout_ms": 1000 * self.wait, "exit_on_failure": True},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "open": {"return_conditions": {"connect_scouted": False}},
            "transport": {"link": {"tx": {
                "lease": 10_000,
                "queue": {"congestion_control": {"block": {"wait_before_close": 600_000_000}}},
            }}},
        }
        return zenoh.Config.from_json5(json.dumps(settings))

    def key(self, name):
        return f"rondo/{self.config['run']}/{name}"

    def next(self, deadline, kinds=()):
        """The next event of these kinds, or of any. Others are held for later. None after the deadline."""
        if not kinds and self.held:
            return self.held.popleft()
        while True:
            try:
                event = self.inbox.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                return None
            if event[0] == "stop":
                raise Leave(AGAIN)
            if not kinds or event[0] in kinds:
                return event
            self.held.append(event)

    def ask(self, name, question, deadline, kinds=()):
        """The answer to a question, asked again until there is one; or an event of `kinds` that comes first."""
        while (now := time.monotonic()) < deadline:
            number = object()
            timeout = min(ASK_AGAIN, deadline - now)
            handler = zenoh.handlers.Callback(
                lambda reply: reply.ok and self.inbox.put(("reply", (number, reply.ok.payload.to_bytes()))),
                lambda: self.inbox.put(("reply", (number, None))),
            )
            self.session.get(self.key(name), handler, payload=question, timeout=timeout,
                             consolidation=zenoh.ConsolidationMode.NONE,
                             congestion_control=zenoh.CongestionControl.BLOCK)
            while event := self.next(now + timeout + 1, ("reply", *kinds)):
                if event[0] != "reply":
                    return event
                of, answer = event[1]
                if of is number and answer is not None:
                    return event[0], answer
                if of is number:  # over: it timed out, or nobody serves the key yet
                    time.sleep(PAUSE)
                    break
        return None

    def take_seat(self):
        reply = self.ask(f"agent/{self.id}/join", self.question, time.monotonic() + self.wait)
        if reply is None:
            raise Leave(AGAIN, f"no seat within {self.wait} s; are env-server and the other agents there?")
        try:
            self.seat, refusal = welcome(reply[1])
        except WireError as error:
            raise Leave(CONFIG, f"cannot read the answer to a request to join: {error}") from None
        if refusal:
            raise Leave(AGAIN if refusal.closing else CONFIG, f"agent {self.id} was refused: {refusal.text}")
        seat = self.seat
        self.learner = Learner(seat.obs_size, seat.n_actions, self.config["algo"]["gamma"])
        self.state = {"round": 0, "update_calls": 0, "remembered": 0}
        if found := self.folder.go_on_from(seat.round):
            state, weights = found
            self.state = {name: state[name] for name in self.state}
            self.learner.weights = array("f", weights[-4 * len(self.learner.weights):])
        self.folder.begin(self.config_bytes)
        self.saved = seat.round
        self.answered = self.answer = None
        self.over = True

        def publisher(name, **qos):
            return self.session.declare_publisher(self.key(name), **qos)

        sure = {"congestion_control": zenoh.CongestionControl.BLOCK, "express": True}
        self.to_world = publisher(f"agent/{self.id}/act", **sure)
        self.to_coordinator = publisher(f"agent/{self.id}/progress", **sure)
        self.to_monitors = publisher(f"agent/{self.id}/metrics", priority=zenoh.Priority.DATA_LOW,
                                     congestion_control=zenoh.CongestionControl.DROP)

        def hand_over(kind):
            return lambda sample: self.inbox.put((kind, sample.payload.to_bytes()))

        def world(sample):
            self.inbox.put(("world", sample.kind == zenoh.SampleKind.PUT))

        # The token comes last: a process that sees it can rely on the subscriptions.
        self.declared = [
            self.session.declare_subscriber(self.key("schedule"), hand_over("rates")),
            self.session.declare_subscriber(self.key(f"world/{self.id}/observe"), hand_over("tick")),
            self.session.liveliness().declare_subscriber(self.key("alive/world"), world, history=True),
            self.session.liveliness().declare_token(self.key(f"alive/agent/{self.id}")),
        ]

    def live(self):
        deadline, gone = time.monotonic() + self.wait, False
        while event := self.next(deadline):
            kind, content = event
            if kind == "world" and (gone or not content):
                deadline = time.monotonic() + (2 * GRACE if content else GRACE)
                gone = True
            elif kind == "rates":
                self.take_rates(content)
            elif kind == "tick":
                try:
                    tick = Observe(content)
                except WireError:
                    self.ignored += 1
                    continue
                deadline, gone = time.monotonic() + self.wait, False
                self.take_tick(tick)
        raise Leave(AGAIN, f"agent {self.id} is alone: the env-server is gone; start it and this agent again")

    def take_tick(self, tick):
        if tick.id == self.answered:
            return self.to_world.put(self.answer)  # the env-server has not received it
        if tick.epoch != self.seat.epoch:
            self.ignored += 1
        elif tick.mode in (FINISHED, STOPPED):
            self.reply(tick, [])
            if tick.mode == FINISHED:
                self.to_coordinator.put(progress(self.state["update_calls"], finished=True))
            raise Leave(DONE if tick.mode == FINISHED else AGAIN)
        elif self.is_next(tick):
            self.play(tick)
        else:
            self.ignored += 1

    def is_next(self, tick):
        copies = self.seat.test_episodes if tick.mode == TEST else self.seat.copies
        fits = (tick.obs_size, tick.n_actions) == (self.seat.obs_size, self.seat.n_actions)
        fits = fits and tick.copies[-1] < copies and (tick.tick > 0 or len(tick.copies) == copies)
        follows = tick.tick == 0 if self.over else (tick.mode, tick.tick) == (self.mode, self.tick + 1)
        return fits and follows and tick.round == self.state["round"]

    def play(self, tick):
        self.mode, self.tick = tick.mode, tick.tick
        if tick.tick == 0:
            self.episodes = [[] for _ in tick.copies]
            # A stream of its own for each round: a round that is played again comes out the same.
            self.chance = random.Random(f"{self.config['seed']} {self.id} {tick.mode} {tick.round}")
        actions = []
        for k, copy in enumerate(tick.copies):
            episode, available = self.episodes[copy], tick.available[k]
            if tick.tick > 0:
                episode[-1][3] = tick.rewards[k]
            if tick.ends[k] == 0:
                x = (*tick.obs[k], 1.0)
                actions.append(self.learner.act(x, available, self.chance))
                episode.append([x, available, actions[-1], 0.0])
        self.over = not actions
        self.reply(tick, actions)
        if self.over and tick.mode == TRAIN:
            self.learn(tick.t_env)

    def reply(self, tick, actions):
        self.answered, self.answer = tick.id, act(tick, actions)
        self.to_world.put(self.answer)

    def learn(self, t_env):
        """The update calls after a training round. Until all rates are there, nothing has changed."""
        state = self.state
        if q := self.config.get("q"):  # one after each episode, once enough are remembered
            lessons = [[e] for k, e in enumerate(self.episodes, 1) if state["remembered"] + k >= q["batch"]]
        else:
            lessons = [self.episodes]
        due = [self.rates_of(call) for call in range(state["update_calls"], state["update_calls"] + len(lessons))]
        t_env += sum(map(len, self.episodes))
        for lesson, (rate, fast_agent) in zip(lessons, due):
            scalars = self.learner.update(lesson, rate)
            state["update_calls"] += 1
            self.to_coordinator.put(progress(state["update_calls"]))
            self.to_monitors.put(metrics(t_env, state["update_calls"], {**scalars, "fast_agent": fast_agent}))
        if lessons:
            self.folder.log(t_env, state["update_calls"], scalars)
        state["round"] += 1
        state["remembered"] += len(self.episodes)
        if state["round"] % self.config["save"]["interval"] == 0:
            self.save()

    def take_rates(self, content):
        try:
            self.schedule.append(rates(content, self.seat.agents))
        except WireError:
            self.ignored += 1

    def rates_of(self, call):
        """This agent's rate in an update call and who leads in it; never guessed, asked for if need be."""
        self.schedule = [known for known in self.schedule if known.until > self.state["update_calls"]]
        deadline = time.monotonic() + self.wait
        while True:
            # What was held back meanwhile may be it.
            for event in [event for event in self.held if event[0] == "rates"]:
                self.held.remove(event)
                self.take_rates(event[1])
            for known in self.schedule:
                if known.first <= call < known.until:
                    return known.rates[known.levels[self.id]], known.fast_agent
            event = self.ask("schedule", rates_query(call), deadline, ("rates",))
            if event is None:
                raise Leave(AGAIN, f"no schedule for update call {call} within {self.wait} s")
            self.take_rates(event[1])

    def save(self):
        if self.state["round"] != self.saved:
            shape = [self.learner.n_actions, self.learner.inputs]
            self.folder.save(self.state, self.learner.weights.tobytes(), shape)
            self.saved = self.state["round"]


def main():
    parser = argparse.ArgumentParser(description="One agent of a Rondo run, in Python")
    parser.add_argument("--id", type=int, required=True, help="which agent of the team, from 0")
    parser.add_argument("--config", type=Path, required=True, help="the run's config.toml, unchanged")
    parser.add_argument("--out", type=Path, required=True, help="the run folder on this host")
    parser.add_argument("--connect", action="append", required=True, help="env-server's endpoint; coordinator's")
    parser.add_argument("--wait", type=int, default=60, help="seconds to wait for the others")
    parser.error = lambda message: (parser.print_usage(sys.stderr), sys.exit(USAGE))
    options = parser.parse_args()
    agent = None
    try:
        agent = Agent(options)
        agent.run()
    except Leave as leave:
        if text := str(leave):
            print(f"error: {text}", file=sys.stderr)
        code = leave.code
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        code = IO
    if agent and agent.ignored:
        print(f"warning: ignored {agent.ignored} messages", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
