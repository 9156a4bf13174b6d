"""The same fit by CasADi: single shooting, Gauss-Newton, exact sensitivities, all that is long compiled.

Written twice. `by_example` is how CasADi's example of system identification does it: one Runge-Kutta step a sample,
`mapaccum` over the run, CasADi's own Jacobian of all residuals. `by_hand` sends the sensitivities along with the states
and sums the normal equations on the way, so that nothing as long as the data is stored. Runs begin at rest; no trims,
no standard errors.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sysid.model.structure import FloatArray, Structure

ENOUGH = 1e-8
"""Promised relative gain at which to stop."""
MOST_STEPS = 30

Run = Callable[..., Any]
"""(parameters, commands above rates (4, n)) -> ..., upper triangle of the curvature, gradient, cost, in one column."""


def _step(casadi: Any, structure: Structure, dt: float) -> tuple[Any, Any, Any, Any]:
    """Symbols x, u and p, and the states one sample later."""
    x, u = casadi.SX.sym("x", len(structure.states)), casadi.SX.sym("u", len(structure.commands))
    p = casadi.SX.sym("p", len(structure.names))

    def rates(x: Any) -> Any:
        parameters = dict(zip(structure.names, casadi.vertsplit(p), strict=True))
        values = (*casadi.vertsplit(x), *casadi.vertsplit(u))
        found, _ = structure.evaluate(
            parameters, dict(zip((*structure.states, *structure.commands), values, strict=True))
        )
        return casadi.vertcat(*(found[f"{state}_dot"] for state in structure.states))

    k1 = rates(x)
    k2 = rates(x + dt / 2 * k1)
    k3 = rates(x + dt / 2 * k2)
    return x, u, p, x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + dt * k3))


def by_example(casadi: Any, structure: Structure, dt: float, lengths: Sequence[int], folder: Path) -> list[Run]:
    x, u, p, after = _step(casadi, structure, dt)
    step = casadi.Function("step", [x, u, p], [after])
    functions = []
    for length in lengths:
        P, data = casadi.MX.sym("P", *p.shape), casadi.MX.sym("D", 4, length)
        states = step.mapaccum(length)(casadi.DM.zeros(*x.shape), data[:2, :], casadi.repmat(P, 1, length))
        e = casadi.vec(data[2:, 1:] - states[:2, :-1])
        J = casadi.jacobian(e, P)
        sums = [casadi.densify(casadi.triu(J.T @ J)), -J.T @ e, e.T @ e]
        functions.append(casadi.Function(f"run_{length}", [P, data], [casadi.veccat(*sums)]))
    return _compiled(casadi, functions, folder)


def by_hand(casadi: Any, structure: Structure, dt: float, lengths: Sequence[int], folder: Path) -> list[Run]:
    x, u, p, after = _step(casadi, structure, dt)
    count, y = p.numel(), casadi.SX.sym("y", 2)
    S, H = casadi.SX.sym("S", x.numel(), count), casadi.SX.sym("H", count, count)
    g, cost = casadi.SX.sym("g", count), casadi.SX.sym("c")
    moved = casadi.jacobian(after, x) @ S + casadi.jacobian(after, p)
    e, J = y - x[:2], S[:2, :]
    later = [after, moved, casadi.triu(H + J.T @ J), g + J.T @ e, cost + e.T @ e]
    state = casadi.veccat(x, S, H, g, cost)
    step = casadi.Function("step", [state, casadi.vertcat(u, y), p], [casadi.veccat(*map(casadi.densify, later))])
    functions = []
    for length in lengths:
        P, data = casadi.MX.sym("P", count), casadi.MX.sym("D", 4, length)
        last = step.fold(length)(casadi.DM.zeros(*state.shape), data, casadi.repmat(P, 1, length))
        functions.append(casadi.Function(f"run_{length}", [P, data], [last]))
    return _compiled(casadi, functions, folder)


def _compiled(casadi: Any, functions: Sequence[Any], folder: Path) -> list[Run]:
    folder.mkdir()
    source = casadi.CodeGenerator("fit.c")
    for function in functions:
        source.add(function)
    source.generate(f"{folder}/")
    library = folder / "fit.so"
    command = ["cc", "-O3", "-march=native", "-fPIC", "-shared", str(folder / "fit.c"), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    return [casadi.external(function.name(), str(library)) for function in functions]


def fit(runs: Sequence[Run], data: Sequence[Any], begin: FloatArray) -> FloatArray:
    """Parameters from a start near them."""
    count = begin.size
    sizes = np.cumsum([count**2, count])

    def summed(values: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        last = sum(run(values, one).full()[:, 0] for run, one in zip(runs, data, strict=True))
        H, g, cost = np.split(last[-(count**2 + count + 1) :], sizes)
        upper = H.reshape(count, count).T
        return upper + np.triu(upper, 1).T, g, float(cost[0])

    values, here = begin, summed(begin)
    for _ in range(MOST_STEPS):
        H, g, cost = here
        size = np.sqrt(np.diag(H))
        move = np.linalg.solve(H / np.outer(size, size), g / size) / size
        if g @ move < ENOUGH * cost:
            break
        there = summed(values + move)
        while there[2] > cost:
            move = move / 2
            there = summed(values + move)
        values, here = values + move, there
    return values
