# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""Wrong predictions of `check` and `analyze`: signs and dropped terms, which their tests must notice."""

CONTACT = "impedance_modules/prediction/contact_geometry.py"
FEASIBILITY = "impedance_modules/prediction/feasibility.py"
FORECAST = "impedance_modules/prediction/forecast.py"
FRICTION = "impedance_modules/prediction/held_by_friction.py"
LOOPS = "impedance_modules/prediction/loop_stability.py"
MECHANISM = "impedance_modules/prediction/mechanism.py"
PASSAGES = "impedance_modules/prediction/passages.py"
PHASE_LOOPS = "impedance_modules/prediction/phase_loops.py"
PHASE_END = "impedance_modules/prediction/phase_end.py"
PATHS = "impedance_modules/prediction/path_following.py"
STATICS = "impedance_modules/prediction/statics.py"

STATICS_TESTS = "tests/prediction/test_statics.py"
CHECK, ANALYSIS = "tests/prediction/test_check.py", "tests/prediction/test_analysis.py"
TESTS = {
    CONTACT: (CHECK,),
    FEASIBILITY: (CHECK, "tests/prediction/test_passages.py"),
    FORECAST: (STATICS_TESTS,),
    FRICTION: (STATICS_TESTS,),
    LOOPS: (CHECK,),
    PASSAGES: ("tests/prediction/test_passages.py",),
    PHASE_LOOPS: ("tests/prediction/test_phase_loops.py",),
    MECHANISM: (CHECK, ANALYSIS),
    PHASE_END: (CHECK,),
    PATHS: ("tests/control/test_recorded_paths.py",),
    STATICS: (CHECK, ANALYSIS, STATICS_TESTS),
}

MUTANTS = (
    (PATHS, "if far > NEAR or turned > NEARLY_TURNED:", "if far > 10.0:"),
    (PATHS, "mechanism.jacobian(spring.frame) * limits", "mechanism.jacobian(spring.frame)"),
    (PATHS, "MARGIN * path.speed / in_ramps_too", "path.speed"),
    (PATHS, "if clock <= path.approach:", "if clock < 0.0:"),
    (CONTACT, "return linear + lever @ angular", "return linear - lever @ angular"),
    (CONTACT, "surface.rotation @ (signs * outside / distance)", "signs * outside / distance"),
    (FEASIBILITY, "if demand[worst] <= limit[worst]:", "if demand[worst] <= 10.0 * limit[worst]:"),
    (FEASIBILITY, "highest = 0.5 * assembly.rate", "highest = assembly.rate"),
    (FEASIBILITY, "press * c.normal @ J", "c.normal @ J"),
    (FEASIBILITY, "return at_rest or list(passage_problems(assembly, mechanism, prediction.motion))", "return at_rest"),
    (LOOPS, "self.fixed.damping + self.scaled.damping", "self.fixed.damping"),
    (MECHANISM, "held.weight @ self.object_jacobian()[:3]", "-held.weight @ self.object_jacobian()[:3]"),
    (MECHANISM, "rows.append(carry(origin - pose.translation)", "rows.append(carry(pose.translation - origin)"),
    (PASSAGES, "(after.time - now.time) * assembly.rate", "(after.time - now.time) * 1000.0"),
    (PASSAGES, "self.size = max(1.0, ", "self.size = max(0.0, "),
    (PASSAGES, "if growth > self.growth or", "if growth < self.growth or"),
    (PHASE_LOOPS, "growth > worst[gains_key(phase)][0]", "growth < worst[gains_key(phase)][0]"),
    (PHASE_END, "if there == until.present else 0.0", "if there != until.present else 0.0"),
    (STATICS, "np.concatenate([force, np.cross(contact.arm, force)])", "np.concatenate([force, np.cross(force, contact.arm)])"),
    (STATICS, "closed and float(np.max(np.abs(self._left))) < BALANCED", "closed"),
    (FORECAST, "damping=system.damping + friction", "damping=friction"),
    (FORECAST, "way, holding = rest.q - phase.q,", "way, holding = phase.q - rest.q,"),
    (FRICTION, "found += contact.surface.fresh_friction", "found -= contact.surface.fresh_friction"),
    (FRICTION, "start if farther else stops", "stops"),
    (FRICTION, "start if farther else stops", "start"),
    (STATICS, "self._hessian + (1.0 / length + 1e-8) * self._mechanism.inertia()", "self._hessian"),
    (STATICS, "longest > LONGEST_STEP and length > SHORTEST", "longest > LONGEST_STEP"),
    (STATICS, "matrix[:k, :k] += contact.surface.stiffness * np.outer", "matrix[:k, :k] += 0.5 * contact.surface.stiffness * np.outer"),
)  # fmt: skip
