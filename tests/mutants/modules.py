# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""Wrong laws of springs, joint springs, objects, equilibria and rotations (``python -m tests.mutants --only modules``)."""

SPRING = "impedance_modules/modules/spring.py"
BIAS = "impedance_modules/modules/joint_bias.py"
OBJECT = "impedance_modules/modules/held_object.py"
SUM = "impedance_modules/modules/sum.py"
POSE = "impedance_modules/modules/pose_motion.py"
SUBMOVEMENTS = "impedance_modules/modules/submovements.py"
PATHS = "impedance_modules/modules/recorded_path.py"
READ_PATHS = "impedance_modules/control/recorded_paths.py"
JERK = "impedance_modules/modules/minimum_jerk.py"
EQUILIBRIUM = "impedance_modules/modules/equilibrium.py"
MOTOR = "impedance_modules/modules/motor_velocity.py"
DAMPING = "impedance_modules/modules/damping.py"
ROTATION = "impedance_modules/robot/rotation.py"
COMPENSATION = "impedance_modules/modules/compensation.py"
DESIRED = "impedance_modules/modules/equilibrium_velocity.py"
TARGETS = "impedance_modules/modules/target_motion.py"
WEIGHT = "impedance_modules/robot/weight_difference.py"
COMPENSATOR = "impedance_modules/control/compensator.py"
DISTANCES = "impedance_modules/robot/distances.py"

LAWS = (
    "tests/modules/test_module_sum.py",
    "tests/modules/test_springs.py",
    "tests/modules/test_equilibrium.py",
)

TESTS = {
    SPRING: LAWS,
    BIAS: LAWS,
    OBJECT: (*LAWS, "tests/modules/test_build_modules.py", "tests/superposition/test_object_impedance.py"),
    SUM: LAWS,
    POSE: (
        "tests/modules/test_equilibrium.py",
        "tests/modules/test_module_sum.py",
        "tests/modules/test_submovements.py",
        "tests/control/test_recorded_paths.py",
    ),
    SUBMOVEMENTS: ("tests/modules/test_submovements.py",),
    PATHS: ("tests/control/test_recorded_paths.py",),
    READ_PATHS: ("tests/control/test_recorded_paths.py",),
    JERK: ("tests/modules/test_equilibrium.py",),
    EQUILIBRIUM: ("tests/modules/test_equilibrium.py", "tests/modules/test_module_sum.py"),
    MOTOR: ("tests/superposition/test_modes.py",),
    DAMPING: ("tests/modules/test_damping.py",),
    COMPENSATION: ("tests/modules/test_compensation.py",),
    DESIRED: ("tests/modules/test_compensation.py",),
    TARGETS: ("tests/modules/test_compensation.py", "tests/modules/test_target_motion.py"),
    WEIGHT: ("tests/modules/test_compensation.py",),
    COMPENSATOR: ("tests/modules/test_compensation.py",),
    ROTATION: (*LAWS, "tests/robot/test_rotation.py"),
    DISTANCES: ("tests/robot/test_distances.py",),
}

MUTANTS = (
    (COMPENSATION, "0.5 * found.stiffness[j] * x) * x", "found.stiffness[j] * x) * x"),
    (COMPENSATION, "total += found.top[j] - (", "total += -("),
    (COMPENSATION, "held += found.offset[j] + found.stiffness[j] * q[j]", "held += found.offset[j] - found.stiffness[j] * q[j]"),
    (COMPENSATION, "found.held[j] = scale * held", "found.held[j] = held"),
    (COMPENSATION, "found.inverse_gain[j] - 1.0) * asked", "found.inverse_gain[j] - 1.0) * others[j]"),
    (COMPENSATION, "if velocity >= 0.0 else found.back", "if velocity < 0.0 else found.back"),
    (COMPENSATION, "+ found.per_load[j] * load", "- found.per_load[j] * load"),
    (DESIRED, "(bias.rest[j] - motion.rest[j]) / motion.period", "(bias.rest[j] - motion.rest[j])"),
    (TARGETS, "turn -= rotation[b, k] * last", "turn += rotation[b, k] * last"),
    (DESIRED, "share = motion.period / (motion.lag[j] + motion.period)", "share = 1.0"),
    (DESIRED, "L[i, j] -= L[i, k] * L[j, k]", "L[i, j] -= 0.0 * L[i, k] * L[j, k]"),
    (WEIGHT, "self.bound - (float(potential) - self._middle)", "self.bound + (float(potential) - self._middle)"),
    (WEIGHT, "self.bound - (float(potential) - self._middle)", "0.1 * self.bound - (float(potential) - self._middle)"),
    (COMPENSATOR, "max((a + 0.5 * k * q) * q for q in (lower[j], upper[j]))", "min((a + 0.5 * k * q) * q for q in (lower[j], upper[j]))"),
    (SPRING, "error[i] = translation[i] - target", "error[i] = target_translation[i] - translation[i] + 0.0 * target"),
    (SPRING, "rotation[i, k] * target_rotation[j, k]", "rotation[k, i] * target_rotation[k, j]"),
    (SPRING, "total += 0.5 * error[i] * stiffness[i, j]", "total += error[i] * stiffness[i, j]"),
    (SPRING, "gradient[3] = x + 0.5 * u", "gradient[3] = x - 0.5 * u"),
    (SPRING, "gradient[4] = y + 0.5 * v + second * (c * u - a * w)", "gradient[4] = y + 0.5 * v"),
    (SPRING, "        turn_moment(error, gradient)\n        for i", "        for i"),
    (SPRING, "wrench[i] = springs.force[s, i] - gradient[i]", "wrench[i] = springs.force[s, i] + gradient[i]"),
    (SPRING, "wrench[i] = springs.force[s, i] - gradient[i]", "wrench[i] = -gradient[i]"),
    (SPRING, "wrench[i] -= springs.damping[s, i, j]", "wrench[i] += springs.damping[s, i, j]"),
    (SPRING, "gradient[i] += scale * springs", "gradient[i] += springs"),
    (SPRING, "effort[j] += jacobian[i, j] * wrench[i]", "effort[j] += 2.0 * jacobian[i, j] * wrench[i]"),
    (SPRING, "return turn @ matrix @ turn.T", "return turn.T @ matrix @ turn"),
    (SPRING, "return abs(axis.force) / axis.speed_limit", "return abs(axis.force) * axis.speed_limit"),
    (BIAS, "total += 0.5 * bias.stiffness[j]", "total += bias.stiffness[j]"),
    (BIAS, "pull = scale * bias.stiffness[j] * (q[j] - bias.rest[j])", "pull = scale * bias.stiffness[j] * q[j]"),
    (BIAS, "pull += bias.damping[j, k] * (velocity[k] -", "pull -= bias.damping[j, k] * (velocity[k] -"),
    (BIAS, "bias.effort[bias.limb[j], j] -= pull", "bias.effort[bias.limb[j], j] += pull"),
    (BIAS, "bias.effort[bias.limb[j], j] -= pull", "bias.effort[0, j] -= pull"),
    (OBJECT, "loads.weight[h, i, k] * R_WO[2, k]", "loads.weight[h, i, k] * R_WO[k, 2]"),
    (OBJECT, "force += R_WO[i, k] * wrench[k]", "force += R_WO[k, i] * wrench[k]"),
    (OBJECT, "loads.squeeze_effort[j] *= loads.grip", "pass"),
    (OBJECT, "loads.weight_effort[j] *= loads.grip", "pass"),
    (OBJECT, "return internal * (force / mean)", "return internal * force"),
    (OBJECT, "towards = -offsets /", "towards = offsets /"),
    (SUM, "modules.desired[j] += modules.efforts[k, j]", "modules.desired[j] = modules.efforts[k, j]"),
    (SUM, "energy = spring_energies(modules.springs, arms) + bias_energy(modules.bias, q)", "energy = spring_energies(modules.springs, arms)"),
    (SUM, "    object_efforts(modules.loads, arms)\n", ""),
    (SUM, "into.springs.force[s] = spring.axis_force()", "pass"),
    (SUBMOVEMENTS, "minimum_jerk((clock - table.start[i]) / table.duration[i])", "minimum_jerk(clock / table.duration[i])"),
    (SUBMOVEMENTS, "out[k] += part * table.by[i, k]", "out[k] = part * table.by[i, k]"),
    (SUBMOVEMENTS, "for i in range(table.first[m], table.first[m + 1]):", "for i in range(table.first[m], table.first[m + 1] - 1):"),
    (SUBMOVEMENTS, "found += slope * np.array(movement.by)", "found = slope * np.array(movement.by)"),
    (SUBMOVEMENTS, "exponential_jacobian(turn) @ rate[3:] + exp3(turn) @ angular", "rate[3:] + exp3(turn) @ angular"),
    (POSE, "+ wave[k] + added[k]", "+ wave[k]"),
    (POSE, "            compose(turn, product, rotation)\n", "            compose(product, turn, rotation)\n"),
    (PATHS, "return x**4 * (2.5 - 3.0 * x + x**2)", "return x**4 * (2.5 - 3.0 * x + x)"),
    (PATHS, "return speed * (since - 0.5 * ramp)", "return speed * since"),
    (PATHS, "b = (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0", "b = (3.0 * f * f * f + 6.0 * f * f + 4.0) / 6.0"),
    (PATHS, "        found[k] /= length\n", "        found[k] *= length\n"),
    (PATHS, "- np.cross(dq, q))", "+ np.cross(dq, q))"),
    (PATHS, "1.5 * f**2 - 2.0 * f,", "1.5 * f**2 + 2.0 * f,"),
    (PATHS, "slope = self._slope(u) * self.rate(clock)", "slope = self._slope(u)"),
    (POSE, "        s = minimum_jerk(clock / motions.paths.approach[m])\n", "        pass\n"),
    (READ_PATHS, "quaternions[1:] * quaternions[:-1], axis=1) < 0.0", "quaternions[1:] * quaternions[:-1], axis=1) < -2.0"),
    (READ_PATHS, "if gap > 0.5 * spacing:", "if gap > 5.0 * spacing:"),
    (READ_PATHS, "    if apart.max() > FARTHEST_OFF:", "    if apart.max() > 100.0 * FARTHEST_OFF:"),
    (READ_PATHS, "if episode.robot != model.spec.name:", "if False:"),
    (JERK, "10.0 - 15.0 * x + 6.0 * x**2", "10.0 - 15.0 * x + 5.0 * x**2"),
    (POSE, "compose(motions.start_rotation[m], turn, product)", "compose(turn, motions.start_rotation[m], product)"),
    (POSE, "local[k] = start + s * (motions.goal[m, k] - start) + wave[k]", "local[k] = start + s * (motions.goal[m, k] - start)"),
    (POSE, "translation[k] += reference[k, j] * local[j]", "translation[k] += reference[j, k] * local[j]"),
    (EQUILIBRIUM, "rest[motion.joint[j]] = start + s", "rest[motion.joint[j]] = start - s"),
    (EQUILIBRIUM, "motion.rotation[m, k, j] * motion.offset_translation[i, j]", "motion.offset_translation[i, k] * (1.0 if j == k else 0.0)"),
    (EQUILIBRIUM, "skew(twist[3:]) @ lever", "-skew(twist[3:]) @ lever"),
    (MOTOR, "motor.velocity[j] = velocity[j] + motor.rate[j]", "motor.velocity[j] = velocity[j] - motor.rate[j]"),
    (MOTOR, "(now - motor.deflection[j]) / motor.period", "(now - motor.deflection[j])"),
    (MOTOR, "motor.share * (", "("),
    (MOTOR, "        motor.deflection[j] = now\n", ""),
    (DAMPING, "X.T @ spring.in_world(spring.stiffness) @ X", "X @ spring.in_world(spring.stiffness) @ X.T"),
    (ROTATION, "entry -= cosine", "entry += cosine"),
    (ROTATION, "return 1.0 / 12.0 + square / 720.0", "return 1.0 / 6.0 + square / 720.0"),
    (ROTATION, "1.0 - half * math.cos(half)", "1.0 + half * math.cos(half)"),
    (ROTATION, "out[0, 2], out[2, 0] = second * x * z + first * y", "out[0, 2], out[2, 0] = second * x * z - first * y"),
    (ROTATION, "if out[3] < 0.0:", "if out[3] > 0.0:"),
    (DISTANCES, "p, q, r = b * z - c * y", "p, q, r = c * y - b * z"),
    (DISTANCES, "free = free_time(state, found[0], -rate)", "free = free_time(state, found[0], rate)"),
    (DISTANCES, "distance - state.margin - (closing", "distance - (closing"),
    (DISTANCES, "if free >= state.period:", "if free >= 0.0:"),
)  # fmt: skip
