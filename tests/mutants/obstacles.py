# SPDX-License-Identifier: BSD-3-Clause
"""Wrong laws of obstacles (``python -m tests.mutants --only obstacles``)."""

LAW = "impedance_modules/modules/obstacle.py"
COUPLED = "impedance_modules/superposition/coupled_arms.py"
SUM = "impedance_modules/modules/sum.py"
FORECAST = "impedance_modules/prediction/obstacle_forecast.py"

LAWS = ("tests/modules/test_obstacles.py",)

TESTS = {LAW: LAWS, COUPLED: LAWS, SUM: LAWS, FORECAST: LAWS}

MUTANTS = (
    (LAW, "turn_back(obstacles.rotation[o], away, local)", "turn(obstacles.rotation[o], away, local)"),
    (LAW, "out[k] = beyond if local[k] > 0.0 else -beyond", "out[k] = beyond"),
    (LAW, "return float(length - obstacles.radius[o])", "return float(length)"),
    (LAW, "return stiffness * distance * (depth - 0.5 * distance)", "return stiffness * distance * depth"),
    (LAW, "return 0.5 * stiffness * depth * depth", "return stiffness * depth * depth"),
    (LAW, "part = min(depth / obstacles.distance[o], 1.0)", "part = depth / obstacles.distance[o]"),
    (LAW, "            force -= (", "            force += ("),
    (LAW, "force = scale * obstacles.stiffness[o]", "force = obstacles.stiffness[o]"),
    (LAW, "total = scale * obstacle_energies(obstacles, arms)", "total = obstacle_energies(obstacles, arms)"),
    (LAW, "half[o] = 0.5 * np.array(spec.size)", "half[o] = np.array(spec.size)"),
    (SUM, "    energy += obstacle_energies(modules.obstacles, arms)\n", ""),
    (COUPLED, "J[:3].T @ K @ J[:3] - turning", "J[:3].T @ K @ J[:3] + turning"),
    (COUPLED, "stiffness = effort + pushed, stiffness + K", "stiffness = effort + pushed, stiffness"),
    (FORECAST, "if p not in nearest or clearance < nearest[p].clearance:", "if p not in nearest:"),
)  # fmt: skip
