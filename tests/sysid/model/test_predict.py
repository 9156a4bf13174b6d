"""Predictions judged by SciPy's and by the independent integrator's simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted import TABLE_4, fly
from scipy.signal import lfilter

from sysid.data.instrument import instruments
from sysid.data.preprocess import EXCITATIONS, Segment, spectra
from sysid.data.record import Record
from sysid.data.stacks import stack
from sysid.fit.output_error import output_error
from sysid.model import predict, relaxation
from sysid.model.acting import divided, either_side, idle, in_time, jumping
from sysid.model.compose import compose
from sysid.model.effect import find
from sysid.model.paper import CD, TPP
from sysid.model.polynomial import exact_enough
from sysid.model.predict import respond
from sysid.model.structure import Model, discretise

TRUTH = np.array(list(TABLE_4.values()))


@pytest.fixture(scope="module")
def runs() -> list[Record]:
    return [Record(f"#{i}", run) for i, run in enumerate(fly(None, {}, seed=4, duration_s=15.0))]


@pytest.mark.parametrize(
    ("structure", "values"), [(TPP, TRUTH * 1.2), (CD, np.array([-2.0, -8, 10, -5, -5, 10, -67, 11]))]
)
@pytest.mark.parametrize("loop_s", [None, 0.001])
def test_the_closed_form_equals_the_matrices(
    runs: list[Record], structure: object, values: np.ndarray, loop_s: float | None
) -> None:
    """Two ways to the same response: polynomials with images in closed form, and the matrix exponential."""
    runs = [replace(one, loop_dt_s=loop_s) for one in runs]
    (group,) = stack(spectra(runs, ("delta_x", "delta_y"), ("p", "q"))[0])
    assert group.held_s == pytest.approx(loop_s or 0.002)
    assert exact_enough(group)
    closed = respond(structure, values, group, False)  # type: ignore[arg-type]
    from sysid.model.predict import _linear

    exact = _linear(structure, values, group, U=group.U, changes=[], of=None)  # type: ignore[arg-type]
    np.testing.assert_allclose(closed.Y, exact.Y, atol=1e-8 * np.abs(exact.Y).max())
    for part in group.slices:  # other columns, of the same end states
        columns, same = (E[..., part].reshape(len(E), -1) for E in (closed.E, exact.E))
        found = np.linalg.lstsq(columns.T, same.T, rcond=None)[0]
        np.testing.assert_allclose(found.T @ columns, same, atol=1e-5 * np.abs(same).max())


def test_slow_sampling_goes_through_the_matrices(runs: list[Record]) -> None:
    slow = [Record(one.id, {name: values[::10] for name, values in one.channels.items()}) for one in runs]
    (group,) = stack(spectra(slow, ("delta_x", "delta_y"), ("p", "q"))[0])
    assert not exact_enough(group)


@pytest.mark.parametrize(
    ("effect", "none"),
    [
        ("servo_saturation", {"limit": 100.0}),
        ("servo_backlash", {"half_width": 0.0}),
        ("quadratic_damping", {"L_pp": 0.0, "M_qq": 0.0, "exponent": 2.0}),
    ],
)
def test_what_changes_nothing_predicts_the_same_in_a_log_of_every_tenth_loop(
    runs: list[Record], effect: str, none: dict[str, float]
) -> None:
    slow = [replace(one, channels={name: row[::10] for name, row in one.channels.items()}) for one in runs]
    (group,) = stack(spectra([replace(one, loop_dt_s=0.002) for one in slow], TPP.inputs, ("p", "q"))[0])
    assert group.thinned_log
    with_it = compose("tpp", [effect])
    values = np.array([{**TABLE_4, **none}[name] for name in with_it.names])
    found, plain = (respond(one, at, group, False).Y for one, at in ((with_it, values), (TPP, TRUTH)))
    assert np.max(np.abs(found - plain)) < 1e-4 * np.max(np.abs(plain))


@pytest.mark.parametrize(
    ("base", "effects", "limited"),
    [("tpp", ["servo_saturation"], "xy"), ("tpp", ["servo_saturation", "input_coupling"], "xy"), ("heave", [], "c")],
)
def test_the_end_of_the_swashplates_tilt_ends_no_collective(
    runs: list[Record], base: str, effects: list[str], limited: str
) -> None:
    """It has a travel of its own, and hovers far from its middle; of a base that is steered by it, it is the limit."""
    collective = 0.55 + 0.1 * runs[0].channels["delta_x"]
    record = replace(runs[0], channels={**runs[0].channels, "delta_c": collective})
    structure = compose(base, effects or ["servo_saturation"], {"delta_c"})
    front, _ = divided(structure)
    segment = spectra([record], structure.inputs, ("p", "q"))[0][0].segment
    acting = in_time(structure, front, segment, {"limit": 0.02})
    for name, row in zip(structure.commands, acting, strict=True):
        is_limited = name.removeprefix("delta_") in limited
        assert np.max(np.abs(row)) == pytest.approx(0.02 if is_limited else collective.max()), name


def test_a_lag_before_play_acts_in_time(runs: list[Record]) -> None:
    """The servo's answer comes first, play takes its part of that: checked against a filter and a loop."""
    structure = compose("tpp", ["servo_backlash", "servo_lag"])
    front, rest = divided(structure)
    assert [one.id for one in front] == ["servo_lag", "servo_backlash"]
    assert rest.effects == ()
    segment = spectra(runs[:1], structure.inputs, ("p", "q"))[0][0].segment
    named = {"tau_s": 0.03, "half_width": 0.01}
    acting = in_time(structure, front, segment, named)
    x = segment.channels["delta_x"]
    a = np.exp(-segment.dt / 0.03)
    lagged = lfilter([0, 1 - a], [1, -a], x - x[0]) + x[0]
    mean = 0.5 * (lagged + np.append(lagged[1:], lagged[-1]))
    expected, v = [], mean[0]
    for value in mean:
        v = min(max(v, value - 0.01), value + 0.01)
        expected.append(v)
    np.testing.assert_allclose(acting[0], expected, atol=1e-9)


@pytest.mark.parametrize("half_width", [0.0, 0.001, 0.012, 0.3])
def test_play_by_clips_of_clips_is_play_by_one_sample_after_the_other(runs: list[Record], half_width: float) -> None:
    play = find("servo_backlash").samples
    assert play is not None
    command = runs[0].channels["delta_x"]
    expected, v = [], command[0]
    for target in command:
        v = min(max(v, target - half_width), target + half_width)
        expected.append(v)
    np.testing.assert_array_equal(play(command[None], 0.002, {"half_width": half_width})[0], expected)


@pytest.mark.parametrize("rate", [0.05, 1.0, 4.0, 30.0])
def test_a_rate_limit_is_one_ramp_after_the_other(runs: list[Record], rate: float) -> None:
    limit = find("servo_rate_limit").samples
    assert limit is not None
    command, step = runs[0].channels["delta_x"], 0.002 * rate
    expected, v = [], command[0]
    for target in command:
        moved = min(max(target - v, -step), step)
        v += moved
        expected.append(v - 0.5 * moved * abs(moved) / step)
    np.testing.assert_allclose(limit(command[None], 0.002, {"rate": rate})[0], expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("acceleration", [0.5, 20.0, 400.0, 2e4, 1e9])
def test_limited_acceleration_is_one_braking_after_the_other(runs: list[Record], acceleration: float) -> None:
    """All samples at once come to what each gives the next, by the closed form of one."""
    braked = find("servo_acceleration_limit").samples
    assert braked is not None
    command, dt = runs[0].channels["delta_x"][:3000], 0.002
    slower = np.sqrt(acceleration / 2) * dt
    expected, v = [], command[0]
    for target in command:
        error = target - v
        root, left = np.sqrt(abs(error)), max(np.sqrt(abs(error)) - slower, 0.0)
        expected.append(target - np.sign(error) * (root**3 - left**3) / (3 * slower))
        v = target - np.sign(error) * left**2
    found = braked(command[None], dt, {"acceleration": acceleration})[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_only_a_dead_band_jumps_with_its_parameter(runs: list[Record]) -> None:
    sizes = {
        "servo_deadband": 0.01, "servo_backlash": 0.01, "servo_rate_limit": 2.0, "servo_saturation": 0.1,
        "servo_acceleration_limit": 100.0,
    }  # fmt: skip
    for name, size in sizes.items():
        structure = compose("tpp", [name])
        (group,) = stack(spectra(runs, structure.inputs, ("p", "q"))[0])
        found = jumping(structure, np.append(TRUTH, size), group)
        assert found == (["width"] if name == "servo_deadband" else []), name


@pytest.mark.parametrize(
    ("name", "acts", "nothing"),
    [
        ("servo_rate_limit", 4.0, 1e6),
        ("servo_acceleration_limit", 500.0, 1e13),
        ("servo_saturation", 0.08, 0.9),
        ("servo_backlash", 0.01, 1e-6),
        ("servo_deadband", 0.01, 1e-7),
    ],
)
def test_what_moves_no_command_is_idle(runs: list[Record], name: str, acts: float, nothing: float) -> None:
    structure = compose("tpp", ["servo_lag", name])
    segments = [one.segment for one in spectra(runs, structure.inputs, ("p", "q"))[0]]
    for size, expected in ((acts, False), (nothing, True)):
        sizes = {"tau_s": 0.05, find(name).names[0]: size}
        values = structure.vector({**dict(zip(TPP.names, TRUTH, strict=True)), **sizes})
        assert idle(structure, values, segments, [name]) == expected
        assert not idle(structure, values, segments, ["servo_lag"]), "what is linear is no question"


def test_every_dead_band_is_seen_to_jump_and_nothing_else_is() -> None:
    """Small steps of a width that by chance moved no jump passed for a slope: in a third of these the width was then
    looked for by its slope, and ended far from the one that flew."""
    sizes = {
        "servo_deadband": (0.005, 0.01, 0.02, 0.03), "servo_backlash": (0.005, 0.03), "servo_saturation": (0.08, 0.15),
        "servo_rate_limit": (0.5, 4.0), "servo_acceleration_limit": (20.0, 500.0),
    }  # fmt: skip
    for seed in range(4):
        runs = [Record("#1", fly(None, {}, seed=70 + seed, duration_s=8.0)[0])]
        for name, values in sizes.items():
            structure = compose("tpp", [name])
            (group,) = stack(spectra(runs, structure.inputs, ("p", "q"))[0])
            for size in values:
                found = jumping(structure, np.append(TRUTH, size), group)
                assert bool(found) == (name == "servo_deadband"), (name, size, seed)


@pytest.mark.parametrize("width", [0.0, 0.004, 0.02, 0.5])
def test_a_dead_band_follows_its_equation_sample_by_sample(width: float) -> None:
    """However many samples in a row do not move the servo, and wherever they end."""
    rng = np.random.default_rng(3)
    for samples in (1, 2, 16, 17, 500):
        commands = np.vstack([np.sin(np.arange(samples) / 40), np.cumsum(rng.normal(0, 0.003, samples))])
        positions = commands.copy()
        for i in range(1, samples):
            stays = np.abs(commands[:, i] - positions[:, i - 1]) <= width
            positions[:, i] = np.where(stays, positions[:, i - 1], commands[:, i])
        acting = find("servo_deadband").samples
        assert acting is not None
        np.testing.assert_array_equal(acting(commands.copy(), 0.0025, {"width": width}), positions)


@pytest.mark.parametrize("effects", [["quadratic_damping"], ["servo_backlash"]])
def test_inputs_in_place_of_the_logged_ones_drive_nonlinear_effects(runs: list[Record], effects: list[str]) -> None:
    """Given what was logged they answer as to the log; given nothing, only what does not depend on inputs is left."""
    structure = compose("tpp", effects)
    (group,) = stack(spectra(runs, structure.inputs, ("p", "q"))[0])
    tiny = {"exponent": 2.0}
    small = np.append(TRUTH, [tiny.get(name, 1e-3) for name in structure.names[TRUTH.size :]])
    logged, given = (respond(structure, small, group, True, U) for U in (None, group.U))
    assert logged.J is not None
    assert given.J is not None
    in_band = group.frequency_hz < 12.0  # above it the log has what the bins given have not
    np.testing.assert_allclose(given.Y[:, in_band], logged.Y[:, in_band], atol=0.05 * np.abs(logged.Y).max())
    still = respond(structure, small, group, False, 0 * group.U)
    np.testing.assert_allclose(still.Y, 0.0, atol=1e-9 * np.abs(logged.Y).max())


def test_play_is_not_forgotten_beside_nonlinear_dynamics(runs: list[Record]) -> None:
    """Relaxation with a nonlinear term of size zero is the linear response, effects on the commands included."""
    plain = compose("tpp", ["servo_backlash", "transport_delay"])
    both = compose("tpp", ["servo_backlash", "transport_delay", "quadratic_damping"])
    groups = stack(spectra(runs, plain.inputs, ("p", "q"))[0])
    extra = {"half_width": 0.02, "T_d": 0.02, "L_pp": 0.0, "M_qq": 0.0, "exponent": 2.0}
    extra |= dict(zip(TPP.names, TRUTH, strict=True))
    linear = output_error(Model(plain, plain.vector(extra)), groups).nrmse_percent
    relaxed = output_error(Model(both, both.vector(extra)), groups).nrmse_percent
    without = output_error(Model(TPP, TRUTH), groups).nrmse_percent
    np.testing.assert_allclose(relaxed, linear, atol=0.1)
    assert np.all(linear < without - 3)


def test_instruments_carry_no_gust(runs: list[Record]) -> None:
    """In calm air the excitation caused nearly all of the commands; where it was not logged, none is known."""
    calm = [Record(f"#{i}", run) for i, run in enumerate(fly(None, {}, seed=4, gusts=0.0, noise=0.0, duration_s=15.0))]
    groups = stack(spectra(calm, ("delta_x", "delta_y"), ("p", "q"))[0])
    caused = instruments(groups, ("delta_x", "delta_y"))
    assert caused is not None
    rest = np.linalg.norm(groups[0].U - caused[0]) / np.linalg.norm(groups[0].U)
    assert rest < 0.1
    bare = [
        Record(one.id, {name: values for name, values in one.channels.items() if name not in EXCITATIONS})
        for one in runs
    ]
    assert instruments(stack(spectra(bare, ("delta_x", "delta_y"), ("p", "q"))[0]), ("delta_x", "delta_y")) is None


def test_an_irregular_clock_keeps_what_a_command_does() -> None:
    """The integral of a held command is kept on the uniform clock, whatever the times of its samples."""
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.choice([0.0025, 0.0033], size=6000))
    u = rng.normal(size=(2, t.size))
    y = np.zeros((2, t.size))
    A, B, C, _ = Model(TPP, TRUTH).matrices
    x = np.zeros(4)
    for k in range(t.size - 1):
        y[:, k] = C @ x
        Ad, Bd = discretise(A, B, t[k + 1] - t[k])
        x = Ad @ x + Bd @ u[:, k]
    y[:, -1] = C @ x
    one = Record("irregular", {"t": t, "p": y[0], "q": y[1], "delta_x": u[0], "delta_y": u[1]})
    found, _ = spectra([one], TPP.inputs, TPP.outputs)
    assert found[0].segment.resampled > 1000
    assert np.all(output_error(Model(TPP, TRUTH), stack(found)).nrmse_percent > 99)


@pytest.mark.parametrize("effects", [["servo_lag"], ["servo_backlash", "transport_delay"], ["quadratic_damping"]])
def test_only_parameters_that_are_asked_for_are_stepped(
    runs: list[Record], effects: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    structure = compose("tpp", effects)
    (group,) = stack(spectra(runs, structure.inputs, ("p", "q"))[0])
    values = np.append(TRUTH, [one.typical for one in structure.parameters[TRUTH.size :]])
    stepped: list[str] = []

    def counted(at: object, named: object, name: str) -> object:
        stepped.append(name)
        return each_step(at, named, name)  # type: ignore[arg-type]

    each_step = relaxation._step
    monkeypatch.setattr(relaxation, "_step", counted)
    asked = [1, values.size - 1]
    found = respond(structure, values, group, True, of=asked).slopes
    many = len(group.spectra) if effects == ["quadratic_damping"] else 0
    assert stepped == [structure.names[i] for i in asked] * many
    every = respond(structure, values, group, True).slopes[asked]
    np.testing.assert_allclose(found, every, atol=1e-3 * np.abs(every).max())
    assert respond(structure, values, group, True, of=[]).slopes.shape == (0, 2, group.z.size)


def test_sensitivities_are_the_same_in_blocks(runs: list[Record], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a log that has not every loop, from rest and from a beginning of its own."""
    structure = compose("tpp", ["servo_lag"])
    slow = [Record(one.id, {name: values[::4] for name, values in one.channels.items()}) for one in runs]
    (group,) = stack(spectra([replace(one, loop_dt_s=0.002) for one in slow], structure.inputs, ("p", "q"))[0])
    values = np.append(TRUTH, 0.03)
    begun = np.ones((len(group.spectra), len(structure.states)))
    for ends in (None, begun):
        monkeypatch.setattr(predict, "BLOCK", 10**6)
        whole = respond(structure, values, group, True, ends=ends).slopes
        monkeypatch.setattr(predict, "BLOCK", 100)
        np.testing.assert_allclose(respond(structure, values, group, True, ends=ends).slopes, whole, rtol=1e-12)


def test_the_logged_bins_of_a_thinned_log_are_worked_out_once(
    runs: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    structure = compose("tpp", ["servo_backlash"])
    slow = Record("slow", {name: values[::4] for name, values in runs[0].channels.items()}, loop_dt_s=0.002)
    (group,) = stack(spectra([slow], structure.inputs, ("p", "q"))[0])
    lengths: list[int] = []

    def counted(self: Segment, rows: np.ndarray, count: int) -> np.ndarray:
        lengths.append(rows.shape[1])
        return bins(self, rows, count)

    bins = Segment.bins
    monkeypatch.setattr(Segment, "bins", counted)
    for half_width in (0.01, 0.02, 0.03):
        respond(structure, np.append(TRUTH, half_width), group, False)
    samples = group.spectra[0].samples
    assert lengths == [samples, 4 * samples, 4 * samples, 4 * samples]


@pytest.mark.parametrize("value", [1e-9, 4e-4, 0.02, 0.9999999])
def test_a_lag_near_its_bound_is_changed_without_reaching_it(value: float) -> None:
    """A yaw fit's motor lag went to zero, and users read of a division by zero."""
    structure = compose("cd", ["motor_lag"])
    above, below = either_side(structure, {"tau_m": value}, "tau_m")
    assert 0 < below < value < above < 1
