# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""Wrong laws of springs between two arms (``python -m tests.mutants --only between_arms``)."""

LAW = "impedance_modules/modules/between_spring.py"
COUPLED = "impedance_modules/superposition/coupled_arms.py"
SUM = "impedance_modules/modules/sum.py"

LAWS = ("tests/modules/test_between_springs.py",)

TESTS = {
    LAW: LAWS,
    SUM: LAWS,
    COUPLED: (*LAWS, "tests/prediction/test_springs_between_arms.py"),
}

MUTANTS = (
    (LAW, "quarter = math.tan(0.25 * angle) / angle", "quarter = math.tan(0.5 * angle) / angle"),
    (LAW, "widening = (0.5 * angle / math.sin(0.5 * angle) - 1.0) / square", "widening = 0.0"),
    (LAW, "turned = C[after, i] * lever[before] - C[before, i] * lever[after]", "turned = C[before, i] * lever[after] - C[after, i] * lever[before]"),
    (LAW, "shared = -along * C[k, i]", "shared = 0.0"),
    (LAW, "error[i], error[3 + i] = -springs.rest_translation[s, i], phi[i]", "error[i], error[3 + i] = springs.rest_translation[s, i], phi[i]"),
    (LAW, "compose(springs.first_axes[s], half, turned)", "compose(half, springs.first_axes[s], turned)"),
    (LAW, "compose(on_second, half, axes)", "axes[:, :] = on_second"),
    (LAW, "wrench[k] -= gradient[i, k] * load[i]", "wrench[k] += gradient[i, k] * load[i]"),
    (LAW, "springs.effort[s, j] += arms.jacobian[f, i, j] * wrench[6 * end + i]", "springs.effort[s, j] += arms.jacobian[f, i, j] * wrench[i]"),
    (LAW, "rate[i] += springs.gradient[s, i, 6 * end + k] * twist", "rate[i] -= springs.gradient[s, i, 6 * end + k] * twist"),
    (LAW, "pull = scale * springs.stiffness[s, i, j] * error[j]", "pull = springs.stiffness[s, i, j] * error[j]"),
    (LAW, "total += 0.5 * error[i] * pull", "total += error[i] * pull"),
    (SUM, "    energy += between_energies(modules.between, arms)\n", ""),
    (SUM, "    energy += between_efforts(modules.between, arms, velocity, scale)\n", ""),
    (COUPLED, "by_turn = turned - by_first[:, 3:] + by_first[:, :3] @ skew(lever)", "by_turn = turned - by_first[:, 3:]"),
    (COUPLED, "stiffness[np.ix_(joints, joints)] -= gamma(", "stiffness[np.ix_(joints, joints)] += gamma("),
    (COUPLED, "self.stiffness[own], self.relaxed[own], -self.effort[joints]", "self.stiffness[own], self.relaxed[own], self.effort[joints]"),
    (COUPLED, "block_diagonal([arm.system.stiffness for arm in single]) + across(coupling.stiffness, parts)", "block_diagonal([arm.system.stiffness for arm in single])"),
    (COUPLED, "return np.asarray(at_hands.T @ (whole - block_diagonal(known)) @ at_hands)", "return np.asarray(at_hands.T @ whole @ at_hands)"),
)  # fmt: skip
