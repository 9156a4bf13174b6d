"""Random storms over whole cards and pushes: every claim against the vehicle's own log and state.

    python tests/study/study_storms.py [FIRST [COUNT]]

Ten minutes of one core for 500 in fake time, six for 20 over sockets. A storm that breaks something is printed with its
seed; its script goes into a file for `tippath sim --faults FILE --seed SEED` as it stands.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]  # before tests/, which has a folder of the same name
sys.path.append(str(ROOT / "tests"))

from storms import CARD, Outcome, Storm, judged_log, play, random_storm  # noqa: E402

STORMS = 500
OVER_SOCKETS = 20
LONGEST_S = 200.0


def _flown(seed: int) -> tuple[str, bool, str]:
    """The storm's kind and exit status, whether something is excused, and what is broken."""
    with tempfile.TemporaryDirectory() as folder:
        outcome = play(random_storm(seed), Path(folder) / "storm")
    return (
        f"{outcome.storm.kind}, exit {outcome.status}",
        bool(outcome.excused),
        outcome.told() if outcome.breaches else "",
    )


def study_nothing_is_claimed_of_random_storms_that_is_not_so() -> None:
    _study(0, STORMS)


def _study(first: int, count: int) -> None:
    with ProcessPoolExecutor() as pool:
        flown = list(pool.map(_flown, range(first, first + count), chunksize=10))
    broken = [told for _, _, told in flown if told]
    print(f"\n{count} storms from {first}: {len(broken)} broken, {sum(excused for _, excused, _ in flown)} excused")
    print(", ".join(f"{number} {kind}" for kind, number in sorted(Counter(kind for kind, _, _ in flown).items())))
    assert not broken, "\n\n".join(broken)


def study_nothing_is_claimed_over_sockets_that_is_not_so() -> None:
    """Processes and UDP: only what they leave behind is compared, not what passed the air."""
    seeds = [seed for seed in range(10_000, 10_100) if random_storm(seed).kind == "card"][:OVER_SOCKETS]
    told = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            outcome = _over_sockets(random_storm(seed), Path(folder))
        print(f"    storm {seed}: exit {outcome.status}", flush=True)
        if outcome.breaches:
            told.append(outcome.told())
    assert not told, "\n\n".join(told)


def _over_sockets(storm: Storm, folder: Path) -> Outcome:
    (folder / "storm.toml").write_text(storm.script)
    (folder / "card.toml").write_text(CARD)
    tippath = [sys.executable, "-m", "gcs.cli"]
    given = ["--plant", "hover-ideal", "--seed", str(storm.seed), "--listen", "udpout:127.0.0.1:0", "--json"]
    sim = subprocess.Popen(
        [*tippath, "sim", *given, "--faults", folder / "storm.toml", "-o", folder / "sd"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=ROOT,
    )
    assert sim.stdout is not None
    try:
        link = json.loads(sim.stdout.readline())["ground_link"]
        words = ["sweep", "--connect", link, "--card", folder / "card.toml", "-o", folder / "flight", "--json"]
        ran = subprocess.run(
            [*tippath, *words], capture_output=True, text=True, cwd=ROOT, timeout=LONGEST_S, check=False
        )
    finally:
        sim.terminate()
        sim.communicate(timeout=20)
    claims = json.loads(ran.stdout) if ran.stdout.strip() else {}
    outcome = Outcome(storm, ran.returncode, " ".join(ran.stderr.split()), claims)
    outcome.breaches += judged_log(outcome, folder)
    if "Traceback" in ran.stderr or ran.returncode not in (0, 1):
        outcome.breaches.append("ended: with a traceback, or an exit status of its own")
    return outcome


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:3]]
    _study(*(given + [0, STORMS][len(given) :]))
