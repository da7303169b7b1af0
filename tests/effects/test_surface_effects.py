"""Errors of a map: what the plant's surface does beyond the task's, the columns find in the forces on the hand."""

from functools import cache

import numpy as np
import pytest

from impedance_modules.effects.apply import apply_to_surfaces
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.effects.surface_effects import touches
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from tests.support.effect_recordings import applied, patch_of, signals_of, start
from tests.support.plant_parts import SIX_JOINTS, exact, plane, spec_of

HAND, SECONDS, C = "port_palm", 2.0, "contact"
RATE = 1000.0


@cache
def wiped(*entries):
    """A palm pressed into a tilted plane and rubbed along it; the map knows the plane without the entries."""
    model = RobotModel(exact(spec_of(SIX_JOINTS)))
    q0 = start(model)
    height = float(model.pose(q0, HAND).translation[2]) - 0.004
    known = plane(height, stiffness=1500.0, damping=5.0, friction=0.3)
    true = apply_to_surfaces((known,), patch_of(model.spec.name, entries)) if entries else (known,)
    subject = Plant(model, true, None, PlantOptions(rate=RATE, seed=0, noise=False))
    subject.reset(q0)
    J = RigidModel.of_robot(model).jacobian(HAND, q0[None])[0, :3]
    towards = np.linalg.pinv(J)
    inertia, deflection, rows = np.diag(model.mass_matrix(q0)), subject.motor_position - q0, []
    for k in range(round(SECONDS * RATE)):
        t = k / RATE
        subject.sense()
        wanted = np.array([0.03 * np.sin(4.0 * t), 0.02 * np.sin(3.0 * t), -0.015 * min(1.0, 2.0 * t)])
        away = subject.motor_position - deflection - q0
        pull = 400.0 * (towards @ wanted - away) - 40.0 * subject.motor_velocity
        rows.append((subject.position, subject.velocity, subject.contact_wrench(HAND)[:3]))
        subject.advance(subject.start_command + inertia * pull)
    q, v, force = (np.array(column) for column in zip(*rows, strict=True))
    motion = (q, v, np.gradient(v, 1.0 / RATE, axis=0), None, None, None)
    signals = signals_of(model, np.arange(len(q)) / RATE, *motion, surfaces=(known,), hands=(HAND,))
    (touch,) = touches(signals, known)
    push = touch.pressure(known)
    speed = np.linalg.norm(touch.sliding, axis=1)
    rub = -(known.friction * push * np.tanh(speed / 0.001) / np.maximum(speed, 1e-9))[:, None] * touch.sliding
    beyond = touch.consumed(force - push[:, None] * touch.normal - rub)
    slides = (speed > 0.02) & (np.linalg.norm(force, axis=1) > 1.0)
    return signals, beyond, slides


CASES = [
    applied("surface_height", C, "surface0", dh=0.0015),
    applied("surface_stiffness", C, "surface0", k=1000.0),
    applied("surface_friction", C, "surface0", mu=0.7),
]


@pytest.mark.parametrize("case", CASES, ids=[case.effect for case in CASES])
def test_the_columns_give_the_map_s_error_back(case) -> None:
    signals, beyond, slides = wiped(case)
    assert slides.sum() > 300
    effect, shape = CATALOGUE[case.effect], {}
    site = Site(signals, case.key, C)
    shapes = effect.shapes(site)
    for _ in range(4):
        shape = effect.next_shape(case.numbers, shape) if shape else dict(shapes[0])
        found = effect.regressor(site, "link", shape)
        column, target = found.columns[slides, :, 0].ravel(), (beyond - found.fixed)[slides].ravel()
        if case.effect != "surface_friction":
            # Along the surface the friction of a pressure that the map has wrong remains.
            J = signals.model.jacobian(HAND, signals.position)[:, :3]
            normal = np.linalg.pinv(np.swapaxes(J, 1, 2)[slides])[:, 2]
            column = np.einsum("ij,ij->i", normal, found.columns[slides, :, 0])
            target = np.einsum("ij,ij->i", normal, (beyond - found.fixed)[slides])
        size = np.array([column @ target / (column @ column)])
        values = effect.values(size, shape, site)
        shape = effect.next_shape(values, shape)
    (symbol, true), *_ = case.numbers.items()
    assert values[symbol] == pytest.approx(true, rel=0.03)


def test_a_true_map_leaves_nothing_and_an_untouched_surface_has_no_columns() -> None:
    signals, beyond, slides = wiped()
    left = np.sqrt(np.mean(beyond[slides] ** 2))
    (touch,) = touches(signals, signals.surfaces[0])
    felt = touch.consumed(touch.pressure(signals.surfaces[0])[:, None] * touch.normal)[slides]
    assert left < 0.03 * np.sqrt(np.mean(felt**2))
    away = Signals(**{**signals.__dict__, "surfaces": (plane(-5.0),)})
    for case in CASES:
        assert CATALOGUE[case.effect].regressor(Site(away, "surface0", C), "link", {"dh": 0.0}) is None
        assert CATALOGUE[case.effect].regressor(Site(signals, "surface1", C), "link", {"dh": 0.0}) is None
