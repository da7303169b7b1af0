# SPDX-License-Identifier: BSD-3-Clause
r"""Two links in a vertical plane, driven through springs with play, by textbook equations: nothing of the package.

    M(q) \ddot q + c(q, \dot q) + g(q) = \tau        \tau = K (\theta - q - clamp(\theta - q, -b/2, b/2))
    I_r \ddot\theta + D \dot\theta = u - \tau          (Spong, Hutchinson & Vidyasagar, section 7.4; Spong 1987)

A position loop around the motors follows a motion of several tones.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.81
MASS, LENGTH, CENTRE, INERTIA = (4.0, 2.5), (0.4, 0.35), (0.22, 0.17), (0.06, 0.03)
"""Of each link [kg], [m], from its joint [m], about its centre [kg.m^2]."""

ROTOR, DAMPING = np.array([0.35, 0.2]), np.array([0.8, 0.5])
"""I_r [kg.m^2] and D [N.m.s/rad]."""

URDF = """<robot name="two_link_arm">
  <link name="base"/>
{links}
</robot>
"""

LINK = """  <link name="link_{i}"><inertial><origin xyz="{centre} 0 0"/><mass value="{mass}"/>
    <inertia ixx="1e-4" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint_{i}" type="revolute"><parent link="{parent}"/><child link="link_{i}"/>
    <origin xyz="{start} 0 0"/><axis xyz="0 -1 0"/><limit lower="-3" upper="3" velocity="5" effort="100"/></joint>"""


def urdf() -> str:
    """The same arm as a description; its x axes point along the links, z upwards."""
    links = [
        LINK.format(
            i=i + 1,
            centre=CENTRE[i],
            mass=MASS[i],
            inertia=INERTIA[i],
            parent=("base", "link_1")[i],
            start=(0.0, LENGTH[0])[i],
        )
        for i in range(2)
    ]
    return URDF.format(links="\n".join(links))


def inverse_inertia(q: np.ndarray) -> np.ndarray:
    (m1, m2), (c1, c2), (i1, i2), l1 = MASS, CENTRE, INERTIA, LENGTH[0]
    bend = l1 * c2 * np.cos(q[1])
    off = i2 + m2 * (c2**2 + bend)
    a, d = i1 + i2 + m1 * c1**2 + m2 * (l1**2 + c2**2 + 2.0 * bend), i2 + m2 * c2**2
    return np.array([[d, -off], [-off, a]]) / (a * d - off**2)


def velocity_torque(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    h = MASS[1] * LENGTH[0] * CENTRE[1] * np.sin(q[1])
    return np.array([-h * (2.0 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2])


def weight(q: np.ndarray) -> np.ndarray:
    (m1, m2), (c1, c2), l1 = MASS, CENTRE, LENGTH[0]
    outer = m2 * c2 * GRAVITY * np.cos(q[0] + q[1])
    return np.array([(m1 * c1 + m2 * l1) * GRAVITY * np.cos(q[0]) + outer, outer])


@dataclass(frozen=True)
class TwoLinkRecording:
    """All (N,) or (N, 2): time, positions of links and motors, torque in the springs and of the motors."""

    time: np.ndarray
    link: np.ndarray
    motor: np.ndarray
    spring: np.ndarray
    drive: np.ndarray


def two_link_recording(
    stiffness: np.ndarray,
    play: np.ndarray,
    seed: int,
    *,
    rate: float = 500.0,
    seconds: float = 8.0,
    centre: tuple[float, float] = (0.4, 0.7),
) -> TwoLinkRecording:
    """Integrates the arm from rest near a random motion of three tones; the first second is its transient."""
    random = np.random.default_rng(seed)
    tones, phase = random.uniform(0.2, 1.2, (3, 2)), random.uniform(0.0, 2.0 * np.pi, (3, 2))
    swing = random.uniform(0.1, 0.25, (3, 2))

    def aim(t: float) -> tuple[np.ndarray, np.ndarray]:
        angle = 2.0 * np.pi * tones * t + phase
        return np.array(centre) + (swing * np.sin(angle)).sum(0), (
            swing * 2.0 * np.pi * tones * np.cos(angle)
        ).sum(0)

    def torques(t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q, theta, turning = x[:2], x[2:4], x[6:]
        lead = theta - q
        spring = stiffness * (lead - np.clip(lead, -0.5 * play, 0.5 * play))
        target, speed = aim(t)
        drive = weight(target) + np.array([900.0, 400.0]) * (target - theta) + 40.0 * (speed - turning)
        return spring, drive

    def motion(t: float, x: np.ndarray) -> np.ndarray:
        spring, drive = torques(t, x)
        q, v, turning = x[:2], x[4:6], x[6:]
        a = inverse_inertia(q) @ (spring - velocity_torque(q, v) - weight(q))
        return np.concatenate([v, turning, a, (drive - spring - DAMPING * turning) / ROTOR])

    begin, speed = aim(0.0)
    deflected = begin - weight(begin) / stiffness
    time = np.arange(0.0, seconds + 1.0, 1.0 / rate)
    found = solve_ivp(
        motion,
        (0.0, time[-1]),
        np.concatenate([deflected, begin, speed, speed]),
        t_eval=time,
        method="LSODA",
        rtol=1e-9,
        atol=1e-11,
        max_step=2e-3,
    )
    kept = time >= 1.0
    spring, drive = zip(*(torques(t, x) for t, x in zip(time, found.y.T, strict=True)), strict=True)
    return TwoLinkRecording(
        time[kept] - 1.0,
        found.y[:2].T[kept],
        found.y[2:4].T[kept],
        np.array(spring)[kept],
        np.array(drive)[kept],
    )
