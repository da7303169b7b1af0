# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""Wrong cycles, set-points, contacts and rows of a recording that the tests must notice."""

CYCLE = "impedance_modules/control/cycle.py"
POINTS = "impedance_modules/control/set_points.py"
CONTROLLER = "impedance_modules/control/controller.py"
CONTACT = "impedance_modules/control/contact_detection.py"
RECORD = "impedance_modules/runs/recorder.py"

TESTS = {
    CYCLE: ("tests/control/test_cycle_laws.py",),
    POINTS: ("tests/control/test_cycle_laws.py",),
    CONTROLLER: ("tests/control/test_cycle_laws.py",),
    CONTACT: ("tests/control/test_contact_detection.py",),
    RECORD: ("tests/control/test_cycle_laws.py",),
}

MUTANTS = (
    (CYCLE, "measure(tank, q, effort, potential_energy(modules, cycle.arms, q))", "measure(tank, q, 0.0 * effort, potential_energy(modules, cycle.arms, q))"),
    (CYCLE, "    rescale_springs(tank)\n", ""),
    (CYCLE, "    estimate_motor_velocity(cycle.motor, velocity, effort)\n", ""),
    (CYCLE, "cycle.motor.velocity, tank.spring_scale)", "velocity, tank.spring_scale)"),
    (CYCLE, "cycle.motor.velocity, tank.spring_scale)", "cycle.motor.velocity, 1.0)"),
    (CYCLE, "cycle.state.available = available(cycle.tank)", "cycle.state.available = cycle.tank.level"),
    (CYCLE, "    write_metric(cycle.problem, cycle.state)\n", ""),
    (CYCLE, "    write_rows(cycle.problem, cycle.limits, cycle.state)\n", ""),
    (CYCLE, "cycle.effort[:] = cycle.active.effort", "cycle.effort[:] = cycle.modules.desired"),
    (CYCLE, "    return limit_effort(cycle, False)", "    return FINE"),
    (CYCLE, "limit_to_budget(cycle.tank, cycle.effort, stopping)", "limit_to_budget(cycle.tank, cycle.effort, True)"),
    (CYCLE, "    cycle.previous[:] = cycle.effort\n", ""),
    (CYCLE, "finite = finite and math.isfinite(value)", "finite = math.isfinite(value)"),
    (POINTS, "now[k] = first[k] + part * (last[k] - first[k])", "now[k] = last[k]"),
    (POINTS, "modules.loads.grip = points.grip_from + part", "modules.loads.grip = part"),
    (POINTS, "if change_cost(tank, potential) <= allowed:", "if True:"),
    (POINTS, "    admit(tank, potential)\n", ""),
    (POINTS, "force_from=np.zeros_like(force) if first", "force_from=force.copy() if first"),
    (POINTS, "return min(BLENDING, duration) if blend is None else blend", "return 1e-9"),
    (CONTROLLER, "tank.spring_scale = given / tank.potential if given > 0.0 else 0.0", "tank.spring_scale = 1.0"),
    (CONTROLLER, "            self.cycle.tank.restore(self._before_gap)\n", "            pass\n"),
    (CONTACT, "return total - held.weight_on_hands", "return total + held.weight_on_hands"),
    (CONTACT, "if as_wanted else 0.0", "if as_wanted else self._held_for"),
    (CONTACT, "(self._measured >= self._force) == self._condition.present", "(self._measured >= self._force)"),
    (RECORD, "values[1 + 2 * n + j] = command[j]", "values[1 + 2 * n + j] = effort[j]"),
    (RECORD, "values[k + 2], values[k + 3], values[k + 4] = cycle.admitted, cycle.effort_scale, cycle.clock", "values[k + 2], values[k + 3], values[k + 4] = cycle.effort_scale, cycle.admitted, cycle.clock"),
)  # fmt: skip
