"""A fuzz of flexinv's public entrances: cases from a grammar, each in a process that may crash or hang without harm.

    python tests/shared/fuzz.py --cases 10000 --jobs 2        # some twenty minutes; a table of refusals by reason
    python tests/shared/fuzz.py --repeat fuzz_failures/1-17.json

Whatever is returned without an error has to close its balances (`fuzz_judge`), of what the grammar calls valid at least four
cases in five have to return an answer, and everything that is raised has to be flexinv's own.  A failure is kept as a file that
repeats it.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import click

TESTS = Path(__file__).resolve().parent
SECONDS = 300.0  # of a processor for one case, which may be the first that needs some kernels compiled
ANSWERED = 0.8  # of the cases that the grammar calls valid


@dataclass
class Worker:
    """A process and the case that it has."""

    process: Any
    line: Connection
    number: int = -1
    since: float = 0.0
    limit: float = SECONDS

    @classmethod
    def begin(cls, seed: int) -> Worker:
        """Start a process."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, seed), daemon=True)
        process.start()
        theirs.close()
        return cls(process, ours)

    def ask(self, number: int) -> None:
        """Give it a case."""
        self.number, self.since = number, self.spent()
        self.line.send(number)

    def spent(self) -> float:
        """Return the time that it has had of the processors [s]; that of the clock where the system does not tell."""
        try:
            fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            return time.monotonic()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def end(self) -> None:
        """Stop it."""
        self.process.kill()
        self.process.join()
        self.line.close()


def _work(line: Connection, seed: int) -> None:
    """Answer case after case until nobody asks any more."""
    sys.path.insert(0, str(TESTS))
    from fuzz_grammar import example
    from fuzz_judge import judged

    while True:
        try:
            case = example(line.recv(), seed)
        except EOFError:
            return
        began = time.monotonic()
        verdict = judged(case)
        line.send((case, verdict, time.monotonic() - began))


@dataclass
class Tally:
    """What has become of the cases so far."""

    answered: Counter[bool] = field(default_factory=Counter)
    asked: Counter[bool] = field(default_factory=Counter)
    refused: Counter[tuple[bool, str]] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)
    failures: list[tuple[int, str]] = field(default_factory=list)
    slowest: list[tuple[float, int]] = field(default_factory=list)
    entrances: dict[str, Counter[str]] = field(default_factory=dict)
    parts: dict[str, Counter[str]] = field(default_factory=dict)
    worst: float = 0.0

    def add(self, number: int, case: Any, verdict: Any, seconds: float) -> None:
        """Count a case."""
        self.asked[case.valid] += 1
        self.answered[case.valid] += verdict.outcome == "answer"
        self.entrances.setdefault(case.call["entrance"], Counter())[verdict.outcome] += 1
        for part in case.parts:
            self.parts.setdefault(part, Counter())[verdict.outcome] += 1
        self.slowest = sorted([*self.slowest, (seconds, number)], reverse=True)[:5]
        self.worst = max(self.worst, verdict.ratio)
        if verdict.outcome == "refused":
            self.refused[case.valid, verdict.reason] += 1
        elif verdict.outcome == "failure":
            self.failed[verdict.reason] += 1
            self.failures.append((number, verdict.message))

    @property
    def share(self) -> float:
        """Of the cases that the grammar calls valid, which part returned an answer [-]."""
        return self.answered[True] / max(self.asked[True], 1)

    def report(self) -> str:
        """Return the tables."""
        out = [
            f"{sum(self.asked.values())} cases: {self.asked[True]} valid, of which {self.share:.1%} return an answer;"
        ]
        out += [f"{self.asked[False]} rough, of which {self.answered[False] / max(self.asked[False], 1):.1%} do"]
        out += [
            f"largest energy error of an answer {self.worst:.2%} of the energy exchanged",
            "",
            "entrance  answer refused failure",
        ]
        out += [
            f"{name:<28}{n['answer']:7d}{n['refused']:8d}{n['failure']:8d}"
            for name, n in sorted(self.entrances.items())
        ]
        out += ["", "made of                      answer refused failure"]
        out += [
            f"{name:<28}{n['answer']:7d}{n['refused']:8d}{n['failure']:8d}" for name, n in sorted(self.parts.items())
        ]
        for valid, title in ((True, "valid"), (False, "rough")):
            out += ["", f"refusals of {title} cases, by reason"]
            rows = [(count, reason) for (own, reason), count in self.refused.items() if own is valid]
            out += [f"{count:7d}  {reason}" for count, reason in sorted(rows, reverse=True)]
        out += ["", "failures, by reason"] + [f"{count:7d}  {reason}" for reason, count in self.failed.most_common()]
        out += ["", "slowest: " + ", ".join(f"case {number} {seconds:.1f} s" for seconds, number in self.slowest)]
        return "\n".join(out) + "\n"


def run(first: int, count: int, seed: int, jobs: int, kept: Path | None = None) -> Iterator[Tally]:
    """Judge so many cases in so many processes; give the tally after every one.  Failures are written to ``kept``."""
    sys.path.insert(0, str(TESTS))
    from fuzz_grammar import example
    from fuzz_judge import Verdict

    tally, ahead = Tally(), iter(range(first, first + count))
    workers = [Worker.begin(seed) for _ in range(min(jobs, count))]
    busy: list[Worker] = []
    for worker in workers:
        worker.ask(next(ahead))
        busy.append(worker)
    try:
        while busy:
            wait([w.line for w in busy], timeout=1.0)
            for worker in list(busy):
                done = _finished(worker)
                if done is None:
                    continue
                if isinstance(done, str):
                    case, verdict, seconds = example(worker.number, seed), Verdict("failure", done, done), SECONDS
                else:
                    case, verdict, seconds = done
                tally.add(worker.number, case, verdict, seconds)
                if verdict.outcome == "failure" and kept is not None:
                    _keep(kept, case, verdict.message)
                if isinstance(done, str):
                    worker.end()
                    busy.remove(worker)
                    worker = Worker.begin(seed)
                    busy.append(worker)
                if (number := next(ahead, None)) is None:
                    worker.end()
                    busy.remove(worker)
                else:
                    worker.ask(number)
                yield tally
    finally:
        for worker in busy:
            worker.end()


def _finished(worker: Worker) -> Any:
    """What a process answers; a sentence where it has died or takes too long, None while it works."""
    if worker.line.poll():
        try:
            return worker.line.recv()
        except EOFError:
            worker.process.join(5.0)
            return f"the process died (exit code {worker.process.exitcode})"
    if worker.spent() - worker.since > worker.limit:
        return f"no answer within {worker.limit:g} s"
    return None


def _keep(folder: Path, case: Any, message: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    whole = json.loads(case.text()) | {"message": message}
    (folder / f"{case.seed}-{case.number}.json").write_text(json.dumps(whole, indent=1), encoding="utf-8")


@click.command()
@click.option("--cases", "count", default=10_000, show_default=True, help="How many cases.")
@click.option("--first", default=0, show_default=True, help="The number of the first one.")
@click.option("--seed", default=1, show_default=True, help="Another seed gives other cases.")
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--out", default="fuzz_failures", show_default=True, help="Folder for failures, each a file.")
@click.option("--repeat", type=click.Path(exists=True, dir_okay=False), help="Judge the case of such a file again.")
def main(count: int, first: int, seed: int, jobs: int, out: str, repeat: str | None) -> None:
    """Fuzz flexinv's public entrances; exit code 1 where something failed."""
    if repeat is not None:
        _again(Path(repeat))
        return
    tally = Tally()
    with click.progressbar(run(first, count, seed, jobs, Path(out)), length=count, file=sys.stderr) as bar:
        for now in bar:
            tally = now
    click.echo(tally.report())
    for number, message in sorted(tally.failures):
        click.echo(f"{out}/{seed}-{number}.json: {message}")
    sys.exit(bool(tally.failures) or tally.share < ANSWERED)


def _again(file: Path) -> None:
    from fuzz_grammar import Example
    from fuzz_judge import judged

    table = json.loads(file.read_text(encoding="utf-8"))
    table.pop("message", None)
    verdict = judged(Example(**table))
    click.echo(f"{verdict.outcome}: {verdict.message}")
    sys.exit(verdict.outcome == "failure")


if __name__ == "__main__":
    main()
