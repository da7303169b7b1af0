# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""Wrong laws of the plant: signs, dropped terms, doubled bounds, transposed rotations, which its tests must notice."""

EQUATIONS = "impedance_modules/plant/equations_of_motion.py"
GRASP = "impedance_modules/plant/grasp.py"
INTEGRATOR = "impedance_modules/plant/integrator.py"
JOINTS = "impedance_modules/plant/joints.py"
LINKS = "impedance_modules/plant/links.py"
OBJECT = "impedance_modules/plant/rigid_object.py"
PALM = "impedance_modules/plant/palm.py"
POINT = "impedance_modules/plant/point_contact.py"
SENSORS = "impedance_modules/plant/sensors.py"
SHEET = "impedance_modules/plant/sheet.py"
WOOD = "impedance_modules/plant/wood.py"

LAWS = ("tests/plant/test_plant_laws.py", "tests/plant/test_plant_equations.py")
PALMS = ("tests/plant/test_palm.py", *LAWS)
TESTS = dict.fromkeys((EQUATIONS, INTEGRATOR, JOINTS, LINKS, POINT, SENSORS, SHEET, WOOD), LAWS)
TESTS |= dict.fromkeys((GRASP, OBJECT, PALM), PALMS)

MUTANTS = (
    # Springs, rotors, stops.
    (JOINTS, "load = joint.stiffness * deflection +", "load = -joint.stiffness * deflection +"),
    (JOINTS, "(motor - load - loss) / joint.reflected_inertia", "(motor - load) / joint.reflected_inertia"),
    (JOINTS, "return float(lead - joint.half_gap)", "return float(lead)"),
    (JOINTS, "float(max(load, 0.0) if deflection > 0.0", "float(load if deflection > 0.0"),
    (JOINTS, "- joint.hold_damping * w", "+ joint.hold_damping * w"),
    (JOINTS, "hold = min(max(hold, -joint.effort_max), joint.effort_max)", "hold = hold"),
    (JOINTS, "joint.load -= joint.reflected_inertia", "joint.load += joint.reflected_inertia"),
    (JOINTS, "joint.effect_motor * w + joint.effect_link * v", "joint.effect_motor * w + joint.effect_link * w"),
    (JOINTS, "return float(min(0.0, joint.stop", "return float(max(-1e9, joint.stop"),
    (JOINTS, "position[i] + joint.motor / joint.stiffness", "position[i] - joint.motor / joint.stiffness"),
    # Links.
    (LINKS, '["acceleration"][:3] = -links.gravity.linear', '["acceleration"][:3] = links.gravity.linear'),
    (LINKS, "along, rest, carried = link.armature, torque, 0.0", "along, rest, carried = 0.0, torque, 0.0"),
    (LINKS, "X[r, c] = X[3 + r, 3 + c] = R[c, r]", "X[r, c] = X[3 + r, 3 + c] = R[r, c]"),
    (LINKS, "link.bias_force[r] -= link.added_mass_world", "link.bias_force[r] += link.added_mass_world"),
    (LINKS, "            add_cross(axis[3:], hand.translation, column)\n", ""),
    (LINKS, "    add_cross(twist[:3], momentum[:3], force[3:])\n", ""),
    (LINKS, "- mass * centre[r] * centre[c]", "+ mass * centre[r] * centre[c]"),
    # Contact.
    (POINT, "bound = contact.friction * normal_force\n", "bound = 2.0 * contact.friction * normal_force\n"),
    (POINT, "bound = contact.friction * contact.normal_force /", "bound = 2.0 * contact.friction * contact.normal_force /"),
    (POINT, "contact.force[k] + normal_force * normal[k]", "contact.force[k] - normal_force * normal[k]"),
    (POINT, "max(0.0, push + contact.damping * approach)", "max(0.0, push - contact.damping * approach)"),
    (POINT, "            add_cross(contact.lever, contact.force, wrench[3:])\n", ""),
    (POINT, "contact.position[k] - origin - contact.radius", "contact.position[k] - origin + contact.radius"),
    (POINT, "= -contact.stiffness * stretch - contact.damping * slide", "= -contact.stiffness * stretch"),
    # Grasp and object.
    (GRASP, "            reaction[3 + k] += moment[k]\n", ""),
    (GRASP, "+ hand.linear_damping * rate[k]", "- hand.linear_damping * rate[k]"),
    (GRASP, "+ hand.angular_damping * spin", "- hand.angular_damping * spin"),
    (GRASP, "        lever[k] -= deflection[k]\n", ""),
    (GRASP, "            hand.least_normal_force = math.inf\n", ""),
    (OBJECT, "turn_back(body.rotation_now, stage", "turn(body.rotation_now, stage"),
    (OBJECT, "= body.gravity[k] +", "= -body.gravity[k] +"),
    (OBJECT, "(body.step_rotation, body.rotation, body.rotation_now)\n    for r", "(body.rotation, body.step_rotation, body.rotation_now)\n    for r"),
    (OBJECT, "gap = half[k] + margin", "gap = half[k] - margin"),
    (OBJECT, "if gap < depth:", "if gap > depth:"),
    (OBJECT, "if cap < side:", "if cap > side:"),
    (OBJECT, "= -1.0 if point[axis] >= 0.0 else 1.0", "= -1.0"),
    (OBJECT, "half[0] + margin - math.hypot", "half[2] + margin - math.hypot"),
    # Palms.
    (PALM, "stretch[k] -= along * hand.normal[k]", "stretch[k] += 0.0 * along"),
    (PALM, "displacement[i, k] - displacement[held, k]\n    _meet", "displacement[held, k] - displacement[i, k]\n    _meet"),
    (PALM, "add_cross(lever, plant.twist[held, 3:], velocity)", "add_cross(plant.twist[held, 3:], lever, velocity)"),
    (PALM, "push + min(max(hand.linear_damping * approach, -push), push)", "max(0.0, push + hand.linear_damping * approach)"),
    (PALM, "push + min(max(hand.linear_damping * approach, -push), push)", "push - min(max(hand.linear_damping * approach, -push), push)"),
    (PALM, "hand.linear_stiffness * max(0.0, hand.depth)", "hand.linear_stiffness * abs(hand.depth)"),
    (PALM, "min(hand.least_normal_force, hand.normal_force)", "hand.normal_force"),
    (PALM, "            velocity[k] -= approach * normal[k]\n", "            velocity[k] -= 0.0 * approach * normal[k]\n"),
    (PALM, "plant.grasp_wrench[i, k] -= hand.normal_force * normal[k]", "plant.grasp_wrench[i, k] += hand.normal_force * normal[k]"),
    (PALM, "bound = hand.friction * hand.normal_force\n", "bound = 2.0 * hand.friction * hand.normal_force\n"),
    (PALM, "wrench[k] -= hand.linear_damping * slide[k]", "wrench[k] += hand.linear_damping * slide[k]"),
    (PALM, "(twist[held, 3 + k] - twist[i, 3 + k])\n", "(twist[i, 3 + k] - twist[held, 3 + k])\n"),
    (PALM, "    _cut(wrench[:3], bound)\n    _cut(wrench[3:], bound * hand.palm_radius)\n    for k", "    for k"),
    (PALM, "    _cut(wrench[:3], bound)\n    _cut(wrench[3:], bound * hand.palm_radius)\n\n", "\n"),
    (PALM, "return longest / length if", "return 2.0 * longest / length if"),
    (PALM, "_slip_about(hand, plant.body.rotation_now, bound * hand.palm_radius)", "_slip_about(hand, plant.body.rotation_now, bound)"),
    (PALM, "point[k] + share * stretch[k]", "point[k] - share * stretch[k]"),
    (PALM, "excess[k] = (share - 1.0) *", "excess[k] = (1.0 - share) *"),
    # All together.
    (EQUATIONS, "plant.grasp_wrench[h, r] + plant.push_wrench[h, r]", "plant.grasp_wrench[h, r]"),
    (EQUATIONS, "(stage.position[i] - start.position[i])", "stage.position[i]"),
    (INTEGRATOR, "weight = 1.0 if stage in {1, 4} else 2.0", "weight = 1.0"),
    (INTEGRATOR, "reach = step if stage == 3 else 0.5 * step", "reach = 0.5 * step"),
    # Sensors.
    (SENSORS, "+ readings.offset[i] + noise[i]", "- readings.offset[i] + noise[i]"),
    (SENSORS, "readings.share * (difference - estimate[i])", "readings.lag_share[i] * (difference - estimate[i])"),
    (SENSORS, "readings.lag_share[i] * (estimate[i] - velocity[i])", "estimate[i] - velocity[i]"),
    # Sheet and wood.
    (SHEET, "change -= 2.0 * (f00", "change += 2.0 * (f00"),
    (SHEET, "- net * depth * found[1]", "+ net * depth * found[1]"),
    (SHEET, "- 2.0 * f01 * p * r", "- f01 * p * r"),
    (WOOD, "wood.friction + found[0] * wood.rough_friction", "wood.friction - found[0] * wood.rough_friction"),
    (WOOD, "friction_work[first + 1] += (1 - a) * b * work", "friction_work[first + 1] += a * b * work"),
    (WOOD, "load = contact.stiffness * (stretch - bound)", "load = contact.stiffness * stretch"),
    (WOOD, "(stretch**2 - bound**2)", "(stretch**2 + bound**2)"),
)  # fmt: skip
