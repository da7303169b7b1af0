# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""Wrong laws of superposition: signs, transposed maps, dropped terms, which its tests must notice."""

ARM = "impedance_modules/superposition/arm_impedance.py"
ELASTIC = "impedance_modules/superposition/elastic_joints.py"
INERTIA = "impedance_modules/superposition/operational_inertia.py"
LOOP = "impedance_modules/superposition/sampled_loop.py"
MODES = "impedance_modules/superposition/modes.py"
NET = "impedance_modules/superposition/net_stiffness.py"
OBJECT = "impedance_modules/superposition/object_impedance.py"
SUM = "impedance_modules/superposition/object_sum.py"

TESTS = {
    ARM: ("tests/superposition/test_loaded_task.py",),
    ELASTIC: ("tests/superposition/test_modes.py", "tests/experiments/test_elastic_joint_model.py"),
    INERTIA: ("tests/superposition/test_object_impedance.py",),
    LOOP: ("tests/superposition/test_modes.py",),
    MODES: ("tests/superposition/test_modes.py",),
    NET: ("tests/superposition/test_net_stiffness.py", "tests/superposition/test_object_impedance.py"),
    OBJECT: ("tests/superposition/test_object_impedance.py", "tests/superposition/test_loaded_task.py"),
    SUM: ("tests/superposition/test_loaded_task.py", "tests/prediction/test_analysis_json.py"),
}

MUTANTS = (
    # Lever arms that turn with the object, squeeze, shares.
    (OBJECT, "= skew(force_on_hand) @ skew(offset)", "= -skew(force_on_hand) @ skew(offset)"),
    (OBJECT, "carried + lever_arm_stiffness(-hand.wrench[:3], hand.offset)", "carried"),
    (OBJECT, "-float(wrench[:3] @ hand.offset)", "float(wrench[:3] @ hand.offset)"),
    (OBJECT, "(hand.wrench + hand.shared) for hand in hands], axis=0)", "hand.wrench for hand in hands], axis=0)"),
    (OBJECT, "shared += carry_weight(", "shared -= carry_weight("),
    (OBJECT, "shared[:, :3] += squeeze_forces(", "shared[:, :3] -= squeeze_forces("),
    (OBJECT, "wrench=arm.wrench - arm.preload", "wrench=arm.wrench + arm.preload"),
    # What is listed as adding up at the object.
    (SUM, "lever_arm_stiffness(-hand.wrench[:3], hand.offset)", "lever_arm_stiffness(hand.wrench[:3], hand.offset)"),
    (SUM, "carry_inertia(matrix, hands[name].offset)", "carry_inertia(matrix, -hands[name].offset)"),
    (SUM, "carry(arm.pose.translation - origin).T @ arm.preload", "arm.preload"),
    (SUM, "arms[name].inertia_without_reflected.inertia for", "arms[name].inertia.inertia for"),
    (SUM, "odd = 0.5 * (matrix - signs", "odd = 0.5 * (matrix + signs"),
    # Frames: X_i maps the object's twist to hand i's.
    (INERTIA, "return X.T @ at_hand @ X", "return X @ at_hand @ X.T"),
    (INERTIA, "X = carry(offset)\n", "X = carry(-offset)\n"),
    (OBJECT, "carry(hand.offset).T @ (hand.wrench", "carry(hand.offset) @ (hand.wrench"),
    (OBJECT, "mobilities.append(np.asarray(np.linalg.inv(object_inertia)))", "pass"),
    # Net stiffness.
    (NET, "loaded = springs - turning", "loaded = springs"),
    (NET, "loaded = springs - turning", "loaded = springs + turning"),
    (NET, "np.tril((turned + twisted).T)", "np.tril(turned.T)"),
    (NET, "np.triu(turned, 1)", "np.triu(turned + twisted, 1)"),
    (NET, "hessian = loaded + jacobian.T @ end_stiffness @ jacobian", "hessian = loaded"),
    (NET, "K[3:, 3:] += _moment_derivative", "K[3:, 3:] -= _moment_derivative"),
    (NET, "jacobian.T @ stiffness @ jacobian - gamma(", "jacobian.T @ stiffness @ jacobian + gamma("),
    (NET, "joint_part + end_damping", "joint_part"),
    # One arm: inertia with its rotors, preload, dampers.
    (ARM, "inertia=operational_inertia(end.jacobian, inverse)", "inertia=operational_inertia(end.jacobian, bare)"),
    (ARM, "load = bias.stiffness * (q[bias.joints] -", "load = -bias.stiffness * (q[bias.joints] -"),
    (ARM, "load = load - part.jacobian.T @ part.wrench", "load = load + part.jacobian.T @ part.wrench"),
    (ARM, "gamma(J, preload)", "0.0 * gamma(J, preload)"),
    (ARM, "side.damping + J.T @ (end.modal + end.explicit) @ J", "side.damping + 2.0 * J.T @ end.modal @ J"),
    # Modes, alone and held together.
    (MODES, "free.inertia + self.twist.T @ object_inertia @ self.twist", "free.inertia"),
    (MODES, "free.stiffness + self.twist.T @ turning @ self.twist", "free.stiffness"),
    (MODES, "springs - gamma + jacobian.T", "springs + gamma + jacobian.T"),
    (MODES, "float(-value.real / frequency)", "float(-0.5 * value.real / frequency)"),
    # Elastic joints and the sampled loop.
    (ELASTIC, "links = inertia - np.diag(np.where(rigid, 0.0, drives.apparent_inertia))", "links = inertia"),
    (ELASTIC, "return math.ceil(ratio - 1e-9)", "return math.floor(ratio)"),
    (ELASTIC, "A, B = loop @ A, loop @ B + push", "A, B = loop @ A, loop @ B"),
    (LOOP, "- gains.damping @ arm.velocity", "+ gains.damping @ arm.velocity"),
    (LOOP, "matrix[size:-k, size + k :] = np.eye(k * (late - 1))", "pass"),
    (LOOP, "root = fixed.stiffness + scale * scaled.stiffness, math.sqrt(scale)", "root = fixed.stiffness + scale * scaled.stiffness, scale"),
)  # fmt: skip
