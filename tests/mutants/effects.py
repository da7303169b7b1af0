# SPDX-License-Identifier: BSD-3-Clause
"""Wrong laws of effects on the plant: signs, dropped terms, wrong joints, which their tests must notice."""

BRISTLES = "impedance_modules/effects/hysteresis.py"
DRIVE = "impedance_modules/effects/drive_path.py"
POSES = "impedance_modules/effects/link_poses.py"
STEP = "impedance_modules/plant/effect_torques.py"
LAW = "impedance_modules/effects/joint_law_torque.py"

TESTS = dict.fromkeys((BRISTLES, DRIVE, LAW, POSES, STEP), ("tests/plant/test_effect_torques.py",))

MUTANTS = (
    (BRISTLES, "torque[i] -= bristles.friction[k]", "torque[i] += bristles.friction[k]"),
    (BRISTLES, "moved = position[i] - bristles.place[k]", "moved = bristles.place[k] - position[i]"),
    (BRISTLES, "        bristles.place[k] = now\n", ""),
    (DRIVE, "(drives.next - drives.age[i]) %", "(drives.next + drives.age[i]) %"),
    (DRIVE, "min(max(total, -drives.limit[i]), drives.limit[i])", "max(total, -drives.limit[i])"),
    (DRIVE, "command + (motion.drive[i] - motion.command[i])", "command"),
    (DRIVE, "asked[i] += drives.crosstalk[i, j]", "asked[i] += drives.crosstalk[j, i]"),
    (DRIVE, "drives.slow[i] + 0.5 * drives.share[i]", "drives.slow[i] + drives.share[i]"),
    (DRIVE, "torque[i] += given - motion.drive[i]", "torque[i] += given"),
    (LAW, "torque[i] -= columns[p] * state.coefficients[k, p]", "torque[i] += columns[p] * state.coefficients[k, p]"),
    (LAW, "velocity = motion.motor_velocity if state.motor", "velocity = motion.velocity if state.motor"),
    (POSES, "axis[4] * y + axis[5] * z", "axis[4] * z + axis[5] * y"),
    (POSES, "x = point[1] * force[2] - point[2] * force[1]", "x = point[1] * force[2] + point[2] * force[1]"),
    (POSES, "out[1] += z * point[0] - x * point[2]", "out[1] += x * point[2] - z * point[0]"),
    (POSES, "point[k] += links.translation[body, k]", "point[k] -= links.translation[body, k]"),
    (STEP, "effect_motor -= coupling[a, b] * together[b]", "effect_motor += coupling[a, b] * together[b]"),
    (STEP, "np.dot(lightness, coupling)", "np.dot(coupling, coupling)"),
    (STEP, "lightness[b, b] = 1.0 / joints[j].reflected_inertia", "lightness[b, b] = 0.0"),
    (STEP, "torque = effects.motor if row.motor else effects.link", "torque = effects.motor"),
)  # fmt: skip
