# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: E501
"""Wrong surfaces: distances and normals of round ones and meshes, which their tests must notice."""

CURVED = "impedance_modules/plant/curved_surface.py"
GEOMETRY = "impedance_modules/prediction/contact_geometry.py"
MESH = "impedance_modules/plant/mesh_surface.py"
READER = "impedance_modules/spec/surface_mesh.py"
SURFACES = "impedance_modules/plant/surfaces.py"

DISTANCES = ("tests/plant/test_surface_distances.py",)
TESTS = dict.fromkeys((CURVED, GEOMETRY, MESH, SURFACES), DISTANCES)
TESTS |= {READER: ("tests/spec/test_surface_mesh.py",)}

MUTANTS = (
    # Round surfaces.
    (CURVED, "math.sqrt(around * around + along * along)", "around + along"),
    (CURVED, "around, along = around / distance, along / distance", "around, along = 1.0, 0.0"),
    (CURVED, "distance = max(side, end)", "distance = min(side, end)"),
    (CURVED, "normal[2] = along if local[2] >= 0.0 else -along", "normal[2] = along"),
    (CURVED, "float(away - surface.half[0])", "float(away - 2.0 * surface.half[0])"),
    (CURVED, "a, b = 1.0 - s / up, 1.0 + s / down", "a, b = 1.0 - s / up, 1.0 - s / down"),
    (CURVED, "+ x * x / (2.0 * up) - y * y / (2.0 * down)", "- x * x / (2.0 * up) - y * y / (2.0 * down)"),
    (CURVED, "-u / (up * length), v / (down * length)", "-u / (up * length), -v / (down * length)"),
    (CURVED, "return float(s * length)", "return float(s)"),
    (CURVED, "abs(v) > surface.half[1]", "abs(v) > surface.half[0]"),
    # Meshes.
    (MESH, "if inside >= 0.0:", "if inside <= 0.0:"),
    (MESH, "feature = k if share == 0.0 else (k + 1) % 3 if share == 1.0 else 3 + k", "feature = FACE"),
    (MESH, "foot[k] = point[k] - height * normal[k]", "foot[k] = point[k] + height * normal[k]"),
    (MESH, "distance = away if along >= 0.0 else -away", "distance = away"),
    (MESH, "if gap >= least:", "if gap >= 0.5 * least:"),
    (MESH, "angle[:, None] * faces", "faces"),
    (MESH, "np.add.at(found, which[:, k], faces)", "found[which[:, k]] = faces"),
    (MESH, 'moved["skip"] += before', 'moved["skip"] += 0'),
    (MESH, 'moved["begin"] += many', 'moved["begin"] += 0'),
    # In the plant and in forecasts.
    (SURFACES, "surface.rotation[j, k] * (position[j]", "surface.rotation[k, j] * (position[j]"),
    (SURFACES, "contact.radius - shape_distance(plant", "contact.radius + shape_distance(plant"),
    (SURFACES, "shape_distance(plant, surface, contact, local) - contact.radius", "shape_distance(plant, surface, contact, local)"),
    (SURFACES, "    turn(surface.rotation, normal, contact.normal)\n", "    contact.normal[:] = normal\n"),
    (SURFACES, "low = -fall - radii[1]", "low = -fall"),
    (GEOMETRY, "(ahead - back) / (2.0 * DIFFERENCE)", "(back - ahead) / (2.0 * DIFFERENCE)"),
    # Files.
    (READER, "forwards != 1", "forwards == 7"),
    (READER, "(used == 1, ", "(used == 0, "),
    (READER, "elif volume[i] < 0.0 and not around.any():", "elif volume[i] < 0.0 and around.any():"),
    (READER, "scale * places", "places"),
    (READER, "known - number if text", "number if text"),
)  # fmt: skip
