# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""What patch export writes: wrong signs, dropped terms, wrong axes, in a URDF and in a MuJoCo model."""

INERTIA = "impedance_modules/export/body_inertia.py"
URDF = "impedance_modules/export/urdf_format.py"
MUJOCO = "impedance_modules/export/mujoco_format.py"
BODIES = "impedance_modules/export/mujoco_bodies.py"
MODEL = "impedance_modules/export/mujoco_model.py"
NUMBERS = "impedance_modules/effects/simulator_numbers.py"
TEXT = "impedance_modules/export/edited_xml.py"
SHAPES = "impedance_modules/export/mujoco_shapes.py"
GEOMS = "impedance_modules/export/geom_inertia.py"

URDF_TESTS = "tests/export/test_urdf_export.py"
MODEL_TESTS = "tests/export/test_mujoco_models.py"

TESTS = {
    INERTIA: (URDF_TESTS, MODEL_TESTS, "tests/export/test_refused_exports.py"),
    URDF: (URDF_TESTS, "tests/export/test_refused_exports.py"),
    MUJOCO: (MODEL_TESTS, "tests/export/test_refused_exports.py"),
    BODIES: (MODEL_TESTS, "tests/export/test_refused_exports.py"),
    MODEL: (MODEL_TESTS, "tests/export/test_refused_exports.py"),
    NUMBERS: (URDF_TESTS, MODEL_TESTS),
    TEXT: ("tests/export/test_edited_xml.py",),
    SHAPES: ("tests/new_robot/test_mujoco_shapes.py",),
    GEOMS: ("tests/new_robot/test_mujoco_shapes.py", "tests/diagnosis/test_model_files.py"),
}

MUTANTS = (
    # a body's ten parameters
    (INERTIA, "about_origin = self.about_centre + steiner(self.mass, self.centre)", "about_origin = self.about_centre"),
    (INERTIA, "about_origin - steiner(mass, centre))", "about_origin - steiner(mass, self.centre))"),
    (INERTIA, "moments = self.mass * self.centre + np.array", "moments = self.mass * self.centre - np.array"),
    (INERTIA, "np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])", "np.array([[xx, xz, xy], [xz, yy, yz], [xy, yz, zz]])"),
    (INERTIA, "mass <= 0.0 or smallest < -ROUNDING * largest", "mass <= 0.0"),
    (INERTIA, "mass <= 0.0 or smallest", "smallest"),
    (INERTIA, "out[i, j] = -out[j, i]", "out[i, j] = out[j, i]"),
    (INERTIA, "about(\"z\", yaw) @ about(\"y\", pitch) @ about(\"x\", roll)", "about(\"x\", roll) @ about(\"y\", pitch) @ about(\"z\", yaw)"),
    (INERTIA, "return 0.0, pitch, math.atan2(-R[0, 1], R[1, 1])", "return 0.0, pitch, math.atan2(R[0, 1], R[1, 1])"),
    # URDF
    (URDF, "dynamics.set(key, number(before + amount.numbers[0]))", "dynamics.set(key, number(amount.numbers[0]))"),
    (URDF, "number(min(before, amount.numbers[0]))", "number(amount.numbers[0])"),
    (URDF, "rotation @ exp3(-offset * axis)", "rotation @ exp3(offset * axis)"),
    (URDF, "rotation @ exp3(-offset * axis)", "exp3(-offset * axis) @ rotation"),
    (URDF, "translation - offset * (rotation @ axis)", "translation - offset * axis"),
    (URDF, "axis = axis / np.linalg.norm(axis)", "axis = 1.0 * axis"),
    (URDF, "(0.0,))[0]) + offset))", "(0.0,))[0]) - offset))"),
    (URDF, "axes @ own @ axes.T", "axes.T @ own @ axes"),
    (URDF, "turned = axes.T @ after.about_centre @ axes", "turned = after.about_centre"),
    (URDF, "origin.set(\"xyz\", numbers(lean @ translation))", "origin.set(\"xyz\", numbers(translation))"),
    (URDF, "rpy_of_rotation(lean @ rotation)", "rpy_of_rotation(lean.T @ rotation)"),
    (URDF, "rpy=numbers(rpy_of_rotation(lean))", "rpy=numbers(rpy_of_rotation(lean.T))"),
    # MuJoCo: joints
    (MUJOCO, "after[power] += amount.numbers[0]", "after[power] = amount.numbers[0]"),
    (MUJOCO, "_add_to_damping(model, amount, 1)", "_add_to_damping(model, amount, 0)"),
    (MUJOCO, "\"frictionloss\", (0.0,))[0]) + amount.numbers[0]", "\"frictionloss\", (0.0,))[0]) - amount.numbers[0]"),
    (MUJOCO, "(0.0,))[0]) + preload", "(0.0,))[0]) - preload"),
    (MUJOCO, "pull / total / unit", "pull / total"),
    (MUJOCO, "pull / total / unit", "pull / stiffness / unit"),
    (MUJOCO, "max(lower, -limit), min(upper, limit)", "-limit, limit"),
    (MUJOCO, "numbers((gain * lower, gain * upper))", "numbers((lower, upper))"),
    (MUJOCO, "numbers(gain * model.numbers(element, \"gear\", (1.0,)))", "numbers((gain,))"),
    (MUJOCO, "gain * model.numbers(element, \"forcerange\", UNLIMITED)", "model.numbers(element, \"forcerange\", UNLIMITED)"),
    (MUJOCO, "\"biasprm\": ()}", "}"),
    (MUJOCO, "element, \"dynprm\", amount.numbers[0])", "element, \"dynprm\", 0.5 * amount.numbers[0])"),
    (MUJOCO, "math.ceil(delay / step) + 1", "1"),
    (MUJOCO, "offset = amount.numbers[0] / unit", "offset = amount.numbers[0]"),
    (MUJOCO, "numbers(model.numbers(joint, \"range\", (0.0, 0.0)) + offset)", "numbers(model.numbers(joint, \"range\", (0.0, 0.0)))"),
    (MUJOCO, "(\"servo gains\", \"torque limit\")", "(\"servo gains\", \"drive lag\")"),
    # MuJoCo: bodies, base
    (BODIES, "R @ np.diag(sized(model, inertial, \"diaginertia\", (0.0,) * 3)) @ R.T", "np.diag(sized(model, inertial, \"diaginertia\", (0.0,) * 3))"),
    (BODIES, "I[0, 1], I[0, 2], I[1, 2]", "I[0, 1], I[1, 2], I[0, 2]"),
    (BODIES, "2.0 * math.atan2(math.hypot(*v), w)", "math.atan2(math.hypot(*v), w)"),
    (BODIES, "unit * angle)", "angle)"),
    (BODIES, "y = _unit(axes[3:] - (axes[3:] @ x) * x)", "y = _unit(axes[3:])"),
    (BODIES, "out @ one if letter.islower() else one @ out", "out @ one"),
    (BODIES, "lean.T @ sized", "lean @ sized"),
    # MuJoCo: what a model says
    (MODEL, "in_degrees and self.joint_type(joint) == \"hinge\"", "in_degrees"),
    (MODEL, "return found[-1] if found else None", "return found[0] if found else None"),
    (MODEL, "if \"childclass\" in around.attrib:", "if \"class\" in around.attrib:"),
    # two effects on one number
    (NUMBERS, "both = np.minimum(a, b)", "both = np.maximum(a, b)"),
    (NUMBERS, "both = a * b", "both = a + b"),
    (NUMBERS, "both = a + b\n", "both = b\n"),
    # the text
    (TEXT, "for start, end, text in sorted(splices, reverse=True):", "for start, end, text in sorted(splices):"),
    (TEXT, "{'\"': \"&quot;\", \"'\": \"&apos;\"}", "{}"),
    # geoms as collision shapes
    (SHAPES, "return turn @ R, place + turn @ p", "return R, place + turn @ p"),
    (SHAPES, "return turn @ R, place + turn @ p", "return turn @ R, place + p"),
    (SHAPES, "2.0 * size[:3]", "size[:3]"),
    (SHAPES, "number(2.0 * float(size[1]))", "number(float(size[1]))"),
    (SHAPES, "-scale * (turn.T @ centre)", "-(turn.T @ centre)"),
    (SHAPES, "-scale * (turn.T @ centre)", "-scale * centre"),
    (SHAPES, "-scale * (turn.T @ centre)", "scale * (turn.T @ centre)"),
    (SHAPES, "R @ turn.T, p + R @ corner", "R @ turn, p + R @ corner"),
    (SHAPES, "R @ turn.T, p + R @ corner", "R @ turn.T, p + corner"),
    (SHAPES, "\"capsule\", np.array([b, a - b])", "\"capsule\", np.array([c, a - c])"),
    (SHAPES, "_cyclic(int(order[2]))", "_cyclic(int(order[0]))"),
    (SHAPES, "np.roll(np.eye(3), axis - 2, axis=0)", "np.eye(3)"),
    (SHAPES, "for key in (\"contype\", \"conaffinity\")", "for key in (\"contype\",)"),
    (GEOMS, "ends[:3] - ends[3:]  #", "ends[3:] - ends[:3]  #"),
    (GEOMS, "0.5 * (ends[:3] + ends[3:])", "0.5 * (ends[:3] - ends[3:])"),
)  # fmt: skip
