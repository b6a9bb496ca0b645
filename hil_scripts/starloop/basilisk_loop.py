"""A spacecraft flown by Basilisk on starloop's pixels: simulator, star tracker and attitude control in one lockstep loop.

    pip install bsk==2.12.1 numpy
    python3 hil_scripts/starloop/basilisk_loop.py --binary target/release/starloop

What happens, ten times a second of simulated time:

1. Basilisk integrates a rigid spacecraft with three reaction wheels over 0.1 s, in steps of 5 ms;
2. its attitude, rate and acceleration every 10 ms go to starloop (`loop.attitude`), which draws what the star sensor sees
   over each exposure and lets its built-in star tracker measure the pixels (`loop.step`, `loop.tracker`);
3. the tracker's attitude, 0.1 s old, is carried on by the gyro's rate and given to Basilisk's flight software
   (`attTrackingError`, `mrpFeedback`, `rwMotorTorque`), which turns the wheels.

The spacecraft slews by 8 degrees and holds. The truth that starloop states for each frame is compared with Basilisk's own
state in the middle of the exposure. Both programs are deterministic: two runs have the same pixels, bit for bit.

Conventions: Basilisk writes modified Rodrigues parameters sigma_BN; starloop wants the quaternion w x y z that turns ICRF axes
into body axes, `starloop.client.wxyz_of_mrp(sigma_BN)`. Basilisk's own Euler parameters are its conjugate.
"""
# mypy: ignore-errors

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path
from typing import Dict, List, NamedTuple, Optional, Tuple

import numpy as np

if not __package__:  # called by its path
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from starloop.client import Starloop, StarloopError, attitude_sample, mrp_of_wxyz, wxyz_of_mrp

ROOT = Path(__file__).resolve().parents[2]
BENCH = ROOT / "configs" / "benches" / "lockstep.toml"

PLANT_STEP_S = 0.005
SAMPLE_S = 0.01
CONTROL_S = 0.1
#: The plant begins so long before the first exposure, so that its first sample is there.
BEGINS_S = -0.1
#: The middle of each exposure is half-way between two samples: what a frame shows is interpolated.
SAMPLES_BEGIN_S = 0.005

TARGET_MRP = (0.10, 0.20, -0.30)
SLEW_DEG = 8.0
SLEW_AXIS = (0.48, -0.6, 0.64)
INERTIA_KG_M2 = (10.0, 9.0, 8.0)
#: A loop of 0.04 Hz with a damping of 0.9: K = 4 J w^2, P = 2 zeta w J.
GAIN_K, GAIN_P = 2.5, 4.5


class State(NamedTuple):
    """State of the spacecraft at one instant of starloop's time."""

    t_s: float
    sigma_bn: np.ndarray
    omega_rad_s: np.ndarray
    omega_dot_rad_s2: np.ndarray


class BasiliskSpacecraft:
    """A rigid spacecraft with three reaction wheels and MRP feedback control."""

    def __init__(self) -> None:
        from Basilisk.architecture import messaging
        from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback, rwMotorTorque
        from Basilisk.simulation import reactionWheelStateEffector, spacecraft
        from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, macros, simIncludeRW

        self._messaging, self._ns = messaging, macros.sec2nano
        self._sim = SimulationBaseClass.SimBaseClass()
        # The plant moves first: a torque acts from its control step on.
        plant, software = self._sim.CreateNewProcess("plant", 200), self._sim.CreateNewProcess("software", 100)
        plant.addTask(self._sim.CreateNewTask("plant", self._ns(PLANT_STEP_S)))
        software.addTask(self._sim.CreateNewTask("software", self._ns(CONTROL_S)))

        self._body = spacecraft.Spacecraft()
        self._body.ModelTag = "spacecraft"
        self._body.hub.mHub = 100.0
        self._body.hub.IHubPntBc_B = np.diag(INERTIA_KG_M2).tolist()
        turn = np.array(SLEW_AXIS) * math.tan(math.radians(SLEW_DEG) / 4.0)
        begin = RigidBodyKinematics.addMRP(np.array(TARGET_MRP), turn)
        self._body.hub.sigma_BNInit = [[part] for part in begin]
        self._body.hub.omega_BN_BInit = [[0.0], [0.0], [0.0]]

        wheels = simIncludeRW.rwFactory()
        for axis in np.eye(3):
            wheels.create("Honeywell_HR14", axis.tolist(), maxMomentum=25.0, Omega=200.0, useRWfriction=False)
        effector = reactionWheelStateEffector.ReactionWheelStateEffector()
        effector.ModelTag = "wheels"
        wheels.addToSpacecraft("wheels", effector, self._body)
        self._sim.AddModelToTask("plant", effector, 2)
        self._sim.AddModelToTask("plant", self._body, 1)
        self._log = self._body.scStateOutMsg.recorder(self._ns(PLANT_STEP_S))
        self._sim.AddModelToTask("plant", self._log, 0)

        reference = inertial3D.inertial3D()
        reference.sigma_R0N = list(TARGET_MRP)
        error = attTrackingError.attTrackingError()
        self._navigation = messaging.NavAttMsg()
        error.attNavInMsg.subscribeTo(self._navigation)
        error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
        control = mrpFeedback.mrpFeedback()
        control.K, control.P, control.Ki = GAIN_K, GAIN_P, -1.0
        control.integralLimit = 1.0
        config = messaging.VehicleConfigMsgPayload(ISCPntB_B=np.diag(INERTIA_KG_M2).flatten().tolist())
        self._config = messaging.VehicleConfigMsg().write(config)
        self._wheel_config = wheels.getConfigMessage()
        control.guidInMsg.subscribeTo(error.attGuidOutMsg)
        control.vehConfigInMsg.subscribeTo(self._config)
        control.rwParamsInMsg.subscribeTo(self._wheel_config)
        control.rwSpeedsInMsg.subscribeTo(effector.rwSpeedOutMsg)
        motors = rwMotorTorque.rwMotorTorque()
        motors.controlAxes_B = np.eye(3).flatten().tolist()
        motors.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
        motors.rwParamsInMsg.subscribeTo(self._wheel_config)
        effector.rwMotorCmdInMsg.subscribeTo(motors.rwMotorTorqueOutMsg)
        for priority, module in zip((4, 3, 2, 1), (reference, error, control, motors)):
            self._sim.AddModelToTask("software", module, priority)
        # Basilisk keeps no reference to what Python has made.
        self._kept = (wheels, effector, reference, error, control, motors)
        self._sim.disableTask("software")
        self._sim.InitializeSimulation()
        self._now_ns = 0

    def know(self, sigma_bn: np.ndarray, omega_rad_s: np.ndarray) -> None:
        """Gives the flight software an attitude and a rate; it begins with the first."""
        payload = self._messaging.NavAttMsgPayload(sigma_BN=list(sigma_bn), omega_BN_B=list(omega_rad_s))
        self._navigation.write(payload, self._now_ns)
        self._sim.enableTask("software")

    def fly(self, until_s: float) -> List[State]:
        """Flies to an instant; returns the states of every plant step since the one before."""
        self._now_ns = self._ns(round(until_s - BEGINS_S, 9))
        self._sim.ConfigureStopTime(self._now_ns)
        self._sim.ExecuteSimulation()
        log = self._log
        states = [
            State(round(1e-9 * int(t_ns) + BEGINS_S, 9), *(np.array(part) for part in parts))
            for t_ns, *parts in zip(log.times(), log.sigma_BN, log.omega_BN_B, log.omegaDot_BN_B)
        ]
        log.clear()
        return states


class Navigation:
    """Carries the tracker's newest attitude on to the present by the rates of an ideal gyro."""

    def __init__(self) -> None:
        self._states: List[State] = []

    def note(self, states: List[State]) -> None:
        """Takes the gyro's rates in; a second of them is kept."""
        self._states = (self._states + states)[-int(1.0 / PLANT_STEP_S) :]

    def attitude(self, seen: Dict) -> Optional[np.ndarray]:
        """Returns sigma_BN now, from what the tracker says; `None` while it says nothing of use."""
        if not seen["valid"]:
            return None
        w, xyz = seen["body_from_icrf"][0], np.array(seen["body_from_icrf"][1:])
        since = [state for state in self._states if state.t_s > seen["mid_exposure_s"] - 1e-9]
        for before, after in zip(since, since[1:]):
            # q(t + dt) = exp(-omega dt / 2) q(t), Hamilton product, scalar first.
            half = -0.5 * (after.t_s - before.t_s) * 0.5 * (before.omega_rad_s + after.omega_rad_s)
            w, xyz = w - half @ xyz, xyz + half * w + np.cross(half, xyz)
        norm = math.sqrt(w * w + xyz @ xyz)
        return np.array(mrp_of_wxyz([w / norm, *(xyz / norm)]))


class Report(NamedTuple):
    """Results of a loop."""

    #: CRC-32 of the pixels of each frame.
    crc32: List[str]
    #: Each frame's stated attitude against Basilisk's state at mid-exposure, arcsec.
    truth_arcsec: List[float]
    #: Distance from the target at the end of each control step: t_s, arcsec.
    pointing: List[Tuple[float, float]]
    #: Frames in which the tracker found an attitude.
    solved: int


def angle_arcsec(a_wxyz, b_wxyz) -> float:
    """Returns the angle between two attitudes."""
    nearest = min(sum((x - sign * y) ** 2 for x, y in zip(a_wxyz, b_wxyz)) for sign in (1.0, -1.0))
    return math.degrees(4.0 * math.asin(min(1.0, 0.5 * math.sqrt(nearest)))) * 3600.0


def is_sent(state: State) -> bool:
    """Whether a state of the plant goes to starloop."""
    return round((state.t_s - SAMPLES_BEGIN_S) / SAMPLE_S, 6).is_integer()


def fly(binary: str, duration_s: float = 60.0, *, sense: int = 1, say=lambda line: None) -> Report:
    """Flies the loop once. `sense` -1 sends the conjugate of each attitude: what the comparison must notice."""
    craft, navigation = BasiliskSpacecraft(), Navigation()
    settings = {"timing.duration_s": duration_s}
    crc32, truth, pointing, solved, seen_frames = [], [], [], 0, set()
    recent: Dict[float, State] = {}
    with Starloop.start(binary, BENCH, settings=settings) as loop:
        for step in range(round((duration_s - BEGINS_S) / CONTROL_S)):
            until_s = round(BEGINS_S + (step + 1) * CONTROL_S, 9)
            states = craft.fly(until_s)
            navigation.note(states)
            recent.update((state.t_s, state) for state in states)
            sent = [state for state in states if is_sent(state)]
            rows = []
            for state in sent:
                w, *xyz = wxyz_of_mrp(state.sigma_bn)
                rows.append(attitude_sample(
                    state.t_s, [w, *(sense * part for part in xyz)], state.omega_rad_s, state.omega_dot_rad_s2
                ))
            loop.attitude(rows)
            loop.step(until_s=until_s)
            seen = loop.tracker()
            solved += seen["valid"] and seen["frame"] not in seen_frames
            seen_frames.add(seen.get("frame"))
            known = navigation.attitude(seen)
            if known is not None:
                craft.know(known, states[-1].omega_rad_s)
            off = angle_arcsec(wxyz_of_mrp(states[-1].sigma_bn), wxyz_of_mrp(TARGET_MRP))
            pointing.append((until_s, off))
            try:
                facts = loop.frame_facts()
            except StarloopError:
                continue  # no frame has gone out yet
            if facts["number"] == len(crc32):
                crc32.append(facts["crc32"])
                state = recent[round(facts["mid_exposure_s"], 9)]
                truth.append(angle_arcsec(facts["meta"]["attitude_wxyz"], wxyz_of_mrp(state.sigma_bn)))
            if step % 50 == 49:
                worst = max(truth, default=float("nan"))
                say(f"{until_s:7.1f} {off:14.1f} {seen.get('stars', 0):6d} {worst:12.5f}")
        loop.finish()
    return Report(crc32, truth, pointing, solved)


def main() -> int:
    """Flies the loop and prints its errors; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", default=os.environ.get("STARLOOP_BINARY", str(ROOT / "target/release/starloop")))
    parser.add_argument("--duration", type=float, default=60.0, help="seconds of simulated time")
    options = parser.parse_args()
    print(f"{'t, s':>7} {'off, arcsec':>14} {'stars':>6} {'truth, arcsec':>12}")
    report = fly(options.binary, options.duration, say=print)
    again = fly(options.binary, options.duration)
    same = "the same" if again.crc32 == report.crc32 else "OTHER"
    print(f"{len(report.crc32)} frames, {report.solved} with an attitude; a second run has {same} pixels, bit for bit")
    print(f"truth of the frames against Basilisk at mid-exposure: at most {max(report.truth_arcsec):.5f} arcsec")
    print(f"pointing at the end: {report.pointing[-1][1]:.1f} arcsec off")
    return 0 if again.crc32 == report.crc32 and max(report.truth_arcsec) < 0.03 else 1


if __name__ == "__main__":
    sys.exit(main())
