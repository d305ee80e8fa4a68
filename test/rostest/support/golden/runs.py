"""The cases that let time run or send many requests: what was done, by their ids.

Where the file does not tell, it was inferred: from what height a box fell, how
fast it slid.
"""

from concurrent.futures import ThreadPoolExecutor
from time import monotonic
from xml.etree import ElementTree

import numpy as np
from rosgraph_msgs.msg import Clock

from ..ros_testing import Connected, idle_seconds, wait_for
from ..wire.raw_subscriber import RawSubscriber
from .cases import plain
from .effects import SHORT
from .simulator import UP, text_of
from .topics import TOPICS

ENDS = ("lower", "upper")
LOOKS = 30
"""Seconds, at most, in which the speed is measured."""
BUSY = 0.2
"""Cores that are idle on a machine that has nothing to spare."""


def at(looks, time):
    """Give height and vertical velocity at a time, between the looks around it."""
    times = [look[0] for look in looks]
    heights = [look[1][2] for look in looks]
    velocities = [look[2][2] for look in looks]
    return np.interp(time, times, heights), np.interp(time, times, velocities)


def joints(simulator):
    """Measure the G1's joints."""
    return simulator.joints("g1_robot", "<robot>")


def pose_of(simulator, link):
    """Give the pose of a link of the G1."""
    position, rotation = simulator.link_pose("g1_robot", link)
    return [*position.tolist(), *rotation.as_quat().tolist()]


def free_fall(simulator, _):
    """Drop the box from 3 m."""
    simulator.put("box", [0.0, 0.0, 3.0, *UP])
    looks = simulator.watch("box", 0.5)
    (near, _), (end, velocity) = at(looks, 0.2), at(looks, 0.5)
    return {"z_at_0_2": near, "z_at_0_5": end, "vz_at_0_5": velocity}


def box_dropped_bounce(simulator, _):
    """Drop the box from 1 m, its lower face from 0.9 m."""
    looks = simulator.watch("box", 1.5)
    touch = next(time for time, pose, _ in looks if pose[2] < 0.105)
    rebound = max(pose[2] for time, pose, _ in looks if time > touch + 0.05)
    return {"time_of_touch": touch, "rebound": rebound}


def box_slides_to_stop(simulator, _):
    """Push the box that lies on the ground."""
    simulator.put("box", [0.0, 0.0, 0.1, *UP], [1.0, *[0.0] * 5])
    _, pose, twist = simulator.watch("box", 1.5)[-1]
    return {"x": pose[0], "speed": float(np.linalg.norm(twist[:3]))}


def spin_is_kept(simulator, _):
    """Let a box drift and spin where nothing pulls."""
    simulator.put("box", [0.0, 0.0, 1.0, *UP], [0.1, 0.0, 0.0, 0.0, 0.0, 2.0])
    return {"twist": simulator.watch("box", 1.0)[-1][2].tolist()}


def robot_hangs_without_gravity(simulator, _):
    """Leave the G1 alone for a second."""
    pelvis = simulator.watch("g1_robot", 1.0)[-1][1].tolist()
    return {"pelvis": pelvis, "largest_joint": largest(joints(simulator), {})}


def largest(first, second):
    """Give the largest difference of two sets of joint positions."""
    return max(abs(value - second.get(name, 0.0)) for name, value in first.items())


def robot_collapses(simulator, _):
    """Let the G1 fall."""
    looks = simulator.watch("g1_robot", 3.0)
    names = {"pelvis_z_0_1": 0.1, "pelvis_z_0_3": 0.3, "pelvis_z_end": 3.0}
    return {name: at(looks, time)[0] for name, time in names.items()}


def weightless_drift(simulator, case):
    """Command all joints and wait a second."""
    response = simulator.send(case["request"][0])
    before = joints(simulator)
    simulator.watch("g1_robot", 1.0)
    return [response], {
        "largest_joint_change": largest(joints(simulator), before),
        "pelvis": pose_of(simulator, "pelvis"),
        "pelvis_twist": simulator.link_twist("g1_robot", "pelvis"),
        "wrist_twist": simulator.link_twist("g1_robot", SHORT["wrist_twist"]),
    }


def paused_stays_paused(simulator, case):
    """Command a joint; look at the time before and after."""
    before = simulator.time()
    response = simulator.send(case["request"][0])
    effect = {"paused": simulator.is_paused()}
    effect["sim_time_moved"] = simulator.time() != before
    effect["knee"] = joints(simulator)[SHORT["knee"]]
    return [response], effect


def twice(simulator, case):
    """Pause or go on, twice."""
    response = [simulator.send(request) for request in case["request"]]
    before = simulator.time()
    paused = simulator.is_paused()
    moved = simulator.time() != before
    return response, {"paused": paused, "sim_time_moved": moved}


def seconds_of(data):
    """Give the time of a message of /clock in [s]."""
    return Clock().deserialize(data).clock.to_sec()


def reset_while_running(simulator, case):
    """Begin again after half a second."""
    clock = RawSubscriber(simulator.master.lookupNode("/gazebo"), "/clock", Clock)
    simulator.watch("box", 0.5)
    simulator.put("box", [3.0, 0.0, 3.0, *UP])
    simulator.call("unpause_physics")
    before = simulator.time()
    response = simulator.send(case["request"][0])
    after = clock.read_until(lambda data: seconds_of(data) < before)[-1]
    small = seconds_of(after) < 0.2
    effect = {"went_back": simulator.time() < before, "after_small": small}
    effect["goes_on"] = seconds_of(clock.read()) > seconds_of(after)
    effect["clock_topic_follows"] = True
    effect["box"] = simulator.state("box")["pose"]
    clock.close()
    return [response], effect


def seen_on_first_message(simulator, case):
    """Command a joint while paused, then let time run."""
    listener = Connected(*TOPICS["link_states"])
    response = simulator.send(case["request"][0])
    simulator.is_paused()
    silent = len(listener.messages)
    simulator.call("unpause_physics")
    message = listener.wait()
    simulator.call("pause_physics")
    listener.close()
    pose = message.pose[message.name.index("g1_robot::left_knee_link")]
    return [response], {"messages_while_paused": silent, "knee_link": plain(pose)}


def configurations(seed, count):
    """Draw configurations of the G1 within its limits."""
    random = np.random.default_rng(seed)
    limits = {
        joint.get("name"): [float(joint.find("limit").get(end)) for end in ENDS]
        for joint in ElementTree.fromstring(text_of("<robot>")).findall("joint")
        if joint.get("type") == "revolute"
    }
    for _ in range(count):
        yield {name: random.uniform(*ends) for name, ends in limits.items()}


def random_walk(simulator, _):
    """Command random configurations within the limits, one after the other."""
    errors = []
    for wanted in configurations(seed=3, count=10):
        simulator.set_joints("g1_robot", wanted)
        errors.append(largest(joints(simulator), wanted))
    pelvis = pose_of(simulator, "pelvis")
    return {"largest_joint_error": max(errors), "pelvis": pelvis}


def many_while_running(simulator, _):
    """Command the G1 fifty times while time runs."""
    simulator.call("unpause_physics")
    failed = 0
    for wanted in configurations(seed=4, count=50):
        failed += not simulator.set_joints("g1_robot", wanted)["success"]
    simulator.call("pause_physics")
    error = largest(joints(simulator), wanted)
    return {"calls_failed": failed, "joints_within_1_mrad": error < 1e-3}


def header(simulator, _):
    """Look at the headers of states asked for one after the other."""
    frames = ("other", "", "")
    headers = [simulator.state("box", frame)["header"] for frame in frames]
    before = simulator.state("other")["header"]["seq"]
    simulator.state("box")
    after = simulator.state("other")["header"]["seq"]
    stamp = headers[-1]["stamp"]
    seconds = stamp["secs"] + 1e-9 * stamp["nsecs"]
    return {
        "seq_steps": np.diff([entry["seq"] for entry in headers]).tolist(),
        "seq_of_other_is_separate": after == before + 1,
        "frame_ids": [entry["frame_id"] for entry in headers[:2]],
        "stamp_is_sim_time": abs(seconds - simulator.time()) < 1e-9,
    }


def real_time(simulator, case):
    """Compare simulated time with wall time, in the best second of some.

    Who has to wait for a core cannot keep the pace: where no core was ever idle it
    counts that the simulator was not too fast.
    """
    simulator.call("unpause_physics")
    wanted = case["effect"]["real_time_factor"]
    factors, idle = [], []
    while len(factors) < LOOKS and not any(abs(f - wanted) < 0.02 for f in factors):
        begin, start, rest = monotonic(), simulator.time(), idle_seconds()
        wait_for(lambda start=start: simulator.time() - start > 1.0, "a second")
        elapsed = monotonic() - begin
        factors.append((simulator.time() - start) / elapsed)
        idle.append((idle_seconds() - rest) / elapsed)
    nearest = min(factors, key=lambda factor: abs(factor - wanted))
    was_busy = max(idle) < BUSY and nearest < wanted
    return {"real_time_factor": wanted if was_busy else nearest}


def parallel_calls(simulator, _):
    """Send the same command forty times at once."""
    request = {"joint_names": ["left_knee_joint"], "joint_positions": [0.5]}

    def call(_):
        proxy = simulator.proxy("set_model_configuration", persistent=False)
        return proxy(model_name="g1_robot", urdf_param_name="", **request)

    with ThreadPoolExecutor(40) as pool:
        answers = list(pool.map(call, range(40)))
    good = all(answer.success for answer in answers)
    knee = joints(simulator)[SHORT["knee"]]
    return {"answers": len(answers), "all_good": good, "knee": knee}


def persistent_connection(simulator, _):
    """Send twenty commands through one connection."""
    answers = [
        simulator.set_joints("g1_robot", {"left_knee_joint": 0.01 * number})
        for number in range(20)
    ]
    return {"good": sum(answer["success"] for answer in answers)}


def all_links_at_zero(simulator, case):
    """Ask for each link's state."""
    return {
        link: simulator.link(f"g1_robot::{link}")["pose"] for link in case["effect"]
    }


def joint_has_no_friction(simulator, _):
    """Give the pendulum a push of a fifth of a second."""
    push = {"joint_name": "swing", "effort": 0.1, "duration": {"nsecs": 200_000_000}}
    simulator.call("apply_joint_effort", **push)
    rates = []
    for seconds in (0.2, 1.0):
        simulator.run(seconds)
        rates.append(simulator.joint("swing")["rate"][0])
    return dict(zip(("rate_after_0_2", "rate_after_1_2"), rates))


def clock_step(simulator, case):
    """Look at the distances of messages on /clock."""
    response = simulator.send(case["request"][0])
    clock = RawSubscriber(simulator.master.lookupNode("/gazebo"), "/clock", Clock)
    simulator.call("unpause_physics")
    times = [seconds_of(clock.read()) for _ in range(20)]
    simulator.call("pause_physics")
    clock.close()
    return [response], {"median_step": float(np.median(np.diff(times)))}


def update_rate(simulator, case):
    """Compare simulated time with wall time."""
    response = simulator.send(case["request"][0])
    return [response], real_time(simulator, case)


def unlimited(simulator, case):
    """Look whether time runs faster than on the wall, or takes all cores there are."""
    response = simulator.send(case["request"][0])
    simulator.call("unpause_physics")
    factors, idle = [], []
    while len(factors) < LOOKS and max(factors, default=0.0) <= 1.0:
        begin, start, rest = monotonic(), simulator.time(), idle_seconds()
        wait_for(lambda start=start: simulator.time() - start > 1.0, "a second")
        elapsed = monotonic() - begin
        factors.append((simulator.time() - start) / elapsed)
        idle.append((idle_seconds() - rest) / elapsed)
    return [response], {"faster_than_real_time": max(factors) > 1.0 or max(idle) < BUSY}


RUNS = {
    "get_link_state.all_links_at_zero": all_links_at_zero,
    "physics.joint_has_no_friction": joint_has_no_friction,
    "set_physics_properties.time_step_seen_in_clock": clock_step,
    "set_physics_properties.update_rate_sets_speed": update_rate,
    "set_physics_properties.rate_zero_is_unlimited": unlimited,
    "get_model_state.header": header,
    "set_model_configuration.random_walk": random_walk,
    "set_model_configuration.paused_stays_paused": paused_stays_paused,
    "set_model_configuration.weightless_drift": weightless_drift,
    "set_model_configuration.many_while_running": many_while_running,
    "set_model_configuration.seen_on_first_message": seen_on_first_message,
    "pause_physics.twice": twice,
    "unpause_physics.twice": twice,
    "reset_simulation.running": reset_while_running,
    "clock.real_time": real_time,
    "services.parallel_calls": parallel_calls,
    "services.persistent_connection": persistent_connection,
    "physics.free_fall": free_fall,
    "physics.box_dropped_bounce": box_dropped_bounce,
    "physics.box_slides_to_stop": box_slides_to_stop,
    "physics.spin_is_kept": spin_is_kept,
    "physics.robot_hangs_without_gravity": robot_hangs_without_gravity,
    "physics.robot_collapses": robot_collapses,
}
"""What does a case and gives the effects; with requests (responses, effects)."""
