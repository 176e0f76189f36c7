"""Table: all scenarios of the zoo."""

from __future__ import annotations

from fleet.config import BatteryConfig
from maps.stations import StationOptions
from tests.zoo.drawings import (
    BACK_TO_BACK,
    CORRIDOR,
    DEAD_END,
    DEAD_END_PARKING,
    EIGHT,
    LOOP,
    NO_PASSING_PLACE,
    RING,
    TWO_ROOMS,
)
from tests.zoo.scenario import ALL, Happening, Scenario, When, blocked, deliveries, delivery, dies, pushed, visit

RMF = "https://github.com/open-rmf"
OSRF = "https://github.com/osrf"
ARXIV = "https://ar5iv.labs.arxiv.org/html"
ONE_SLOT = StationOptions(slots=((-0.190, 0.408, 0.25),))
SMALL_BATTERY = {"capacity_wh": 2.0, "awake_w": 15.0}
"""Empty after eight minutes of standing, full after a minute at the charger."""
CUT_OFF = "work that wrecks or boxes cut off stays open until the run stalls: nothing says that it is impossible"
ONE_WAY = "lanes are driven one way even where a wreck or a box leaves no other way"
ONLY_ITS_CAR = "an order that only a dead car may do stays open until the run stalls"
NO_CAR = "orders stay open until the run stalls when no car lives"


def everywhere(why: str) -> dict[str, str]:
    """It fails today at every fidelity."""
    return dict.fromkeys(ALL, why)


def off_the_grid(why: str) -> dict[str, str]:
    """It fails today wherever a push moves a car off its lane; on the grid it keeps its state."""
    return {"kinematic": why, "physics": why}


def but_with_physics(why: str) -> dict[str, str]:
    """It fails today wherever a car moves as it is told; with physics it also rolls."""
    return {"grid": why, "kinematic": why}


TRAFFIC = (
    Scenario(
        name="head_on_corridor",
        what="Cars with parcels and cars without meet in a corridor that is driven both ways.",
        source=f"{OSRF}/rmf_core/issues/145",
        site=CORRIDOR,
        robots=3,
        orders=deliveries(4),
        longest_s=150,
        fails_today=everywhere(
            "cars that back up into each other's lane at the drop dock wait for each other in a circle"
        ),
    ),
    Scenario(
        name="swap_patrol",
        what="Two cars patrol between the same two places, each the other way round.",
        source=f"{RMF}/rmf_ros2/issues/503",
        site="cell",
        robots=2,
        orders=(
            visit("a", *["parking_1", "parking_3"] * 3, kind="patrol", needs="car_0", stand_s=1),
            visit("b", *["parking_3", "parking_1"] * 3, kind="patrol", needs="car_1", stand_s=1),
        ),
        longest_s=200,
    ),
    Scenario(
        name="corridor_patrols",
        what="Patrols lead through a corridor from both ends at once.",
        source=f"{RMF}/rmf/issues/711",
        site=CORRIDOR,
        robots=4,
        orders=(
            visit("a", "1,5", "1,9", "1,5", kind="patrol", needs="car_0"),
            visit("b", "1,9", "1,5", "1,9", kind="patrol", needs="car_1"),
            visit("c", "5,9", "5,5", "5,9", kind="patrol", needs="car_2"),
            visit("d", "5,5", "5,9", "5,5", kind="patrol", needs="car_3"),
        ),
        longest_s=300,
    ),
    Scenario(
        name="crossing",
        what="Two streams of cars cross in one cell, and each car comes through it twice.",
        source=f"{RMF}/rmf/issues/356",
        site=EIGHT,
        robots=6,
        orders=deliveries(6),
        longest_s=400,
    ),
    Scenario(
        name="patrols_through_one_cell",
        what="Four cars stand one after the other in the one cell that all of them have to cross.",
        source=f"{RMF}/rmf_ros2/issues/448",
        site=EIGHT,
        robots=4,
        orders=tuple(
            visit(name, "4,5", "4,1", "4,5", kind="patrol", stand_s=2, needs=f"car_{k}")
            for k, name in enumerate("abcd")
        ),
        longest_s=300,
    ),
    Scenario(
        name="idle_blocker",
        what="Idle cars are parked in the only lane, and one has to pass.",
        source=f"{OSRF}/rmf_core/issues/303",
        site=RING,
        robots=4,
        orders=deliveries(2, needs="car_0"),
        longest_s=250,
    ),
    Scenario(
        name="stands_in_the_lane",
        what="A car inspects something in the only lane while another has to pass.",
        source=f"{OSRF}/rmf_core/issues/304",
        site=RING,
        robots=2,
        orders=(visit("look", "3,4", kind="inspect", needs="car_1", stand_s=10), delivery("a", needs="car_0")),
        longest_s=150,
    ),
    Scenario(
        name="same_goal",
        what="Three cars are sent to the same place at the same time.",
        source=f"{OSRF}/rmf_demos/pull/213",
        site="cell",
        robots=3,
        orders=tuple(visit(name, "6,5", needs=f"car_{k}", stand_s=3) for k, name in enumerate("abc")),
        longest_s=120,
    ),
    Scenario(
        name="occupied_parking",
        what="A car is sent to a parking place in which an idle car stands.",
        source=f"{RMF}/rmf_ros2/pull/325",
        site="cell",
        robots=2,
        orders=(visit("a", "parking_2", kind="park", needs="car_0", stand_s=3),),
        longest_s=120,
    ),
    Scenario(
        name="leaves_its_goal",
        what="Two cars have their goals so that the second can come to its own only if the first leaves again.",
        source="https://github.com/IMRCLab/db-CBS/issues/48",
        site=RING,
        robots=2,
        orders=(
            visit("a", "parking_4", kind="park", needs="car_1", stand_s=5),
            visit("b", "drop_1", needs="car_0", stand_s=5),
        ),
        longest_s=120,
        tries_physics=True,
    ),
    Scenario(
        name="full_roundabout",
        what="Ten cars in a loop of twelve cells: nobody moves unless nearly all do.",
        source=f"{ARXIV}/1901.11282",
        site=LOOP,
        robots=10,
        orders=deliveries(4),
        longest_s=600,
    ),
    Scenario(
        name="more_cars_than_a_loop_holds",
        what="A run asks for more cars than the loop has places to stand in.",
        source="https://studylib.net/doc/13886935/multi-agent-path-finding-on-strongly-biconnected-digraphs...",
        site=LOOP,
        robots=11,
        orders=deliveries(1),
        refused=r"ConfigError: --robots is 11; valid: 1 to 10",
        longest_s=10,
    ),
    Scenario(
        name="docks_back_to_back",
        what="The exit of one dock is the entrance of the next, and both have queues.",
        source=f"{ARXIV}/1705.10868",
        site=BACK_TO_BACK,
        robots=4,
        orders=tuple(
            delivery(f"{pick}_{drop}_{k}", f"pick_{pick}", f"drop_{drop}")
            for k in (1, 2)
            for pick in (1, 2)
            for drop in (1, 2)
        ),
        longest_s=400,
    ),
    Scenario(
        name="dead_end",
        what="Two cars have to go to the end of a pocket that they can only leave backwards.",
        source=f"{ARXIV}/2205.12504",
        site=DEAD_END,
        robots=2,
        orders=(visit("a", "7,5", needs="car_0", stand_s=3), visit("b", "7,5", needs="car_1", stand_s=3)),
        longest_s=90,
        fails_today=everywhere(
            "the idle car in the pocket and the one behind it wait for each other: PIBT cannot swap in a dead end"
        ),
    ),
    Scenario(
        name="no_passing_place",
        what="A two-way lane is drawn in which nobody can step aside.",
        source="https://github.com/CoffeeKumazaki/arXiv/issues/14917",
        site=NO_PASSING_PLACE,
        robots=1,
        orders=deliveries(1),
        refused=r"PlanError: .*no passing place",
        longest_s=10,
    ),
    Scenario(
        name="dead_end_parking",
        what="A parking place is drawn that cars cannot leave.",
        source=f"{RMF}/rmf_demos/issues/45",
        site=DEAD_END_PARKING,
        robots=1,
        orders=deliveries(1),
        refused=r"LaneError: .*parking cell at row 7, column 7 is a dead end",
        longest_s=10,
    ),
    Scenario(
        name="crowded_small_floor",
        what="Eight cars on a small floor whose planner must not go on for ever without anybody moving.",
        source=f"{RMF}/rmf/issues/373",
        site="twin",
        robots=8,
        orders=tuple(delivery(f"o{k}", f"pick_{1 + k % 2}", f"drop_{1 + k // 2 % 2}") for k in range(8)),
        longest_s=400,
    ),
)

WRECKS = (
    Scenario(
        name="wreck_in_only_dock",
        what="A car breaks down in the only pick dock before the parcels are fetched.",
        source=f"{RMF}/rmf_ros2/issues/16",
        site="cell",
        robots=2,
        orders=(visit("halt", "pick_1", needs="car_1", stand_s=1), *deliveries(2, after="halt")),
        happens=(dies(car="car_1", at=(3, 1), phases=("idle",)),),
        not_done={"a": "pick_1|car_1", "b": "pick_1|car_1"},
        longest_s=90,
        fails_today=everywhere(CUT_OFF),
    ),
    Scenario(
        name="wreck_in_one_of_two_docks",
        what="A car breaks down in one of two drop docks: what goes to the other is delivered.",
        source=f"{RMF}/rmf_ros2/pull/338",
        site=BACK_TO_BACK,
        robots=3,
        orders=(
            visit("halt", "drop_1", needs="car_2", stand_s=1),
            delivery("a", "pick_1", "drop_1", after="halt"),
            delivery("b", "pick_1", "drop_2", after="halt"),
            delivery("c", "pick_2", "drop_2", after="halt"),
        ),
        happens=(dies(car="car_2", at=(3, 10), phases=("idle",)),),
        not_done={"a": "drop_1|car_2"},
        longest_s=150,
        fails_today=everywhere(
            "a parcel is loaded for the cut-off dock, its car is retired, and c waits for a way against a lane"
        ),
    ),
    Scenario(
        name="wreck_in_only_lane",
        what="A car breaks down in a loop of one lane: the other way round everything can still be reached.",
        source="https://sage.cnpereading.com/doi/10.5772/62685",
        site=RING,
        robots=2,
        orders=(visit("halt", "1,7", needs="car_1", stand_s=1), delivery("a", after="halt")),
        happens=(dies(car="car_1", at=(1, 7), phases=("idle",)),),
        longest_s=120,
        fails_today=everywhere(ONE_WAY),
    ),
    Scenario(
        name="wreck_in_one_corridor",
        what="A car breaks down in the corridor to the drop room; the one back is still free.",
        source=f"{RMF}/rmf_ros2/issues/519",
        site=TWO_ROOMS,
        robots=2,
        orders=(visit("halt", "5,8", needs="car_1", stand_s=1), delivery("a", after="halt")),
        happens=(dies(car="car_1", at=(5, 8), phases=("idle",)),),
        longest_s=120,
        fails_today=everywhere(ONE_WAY),
    ),
    Scenario(
        name="two_wrecks_cut_the_floor",
        what="Cars break down in both corridors between two rooms.",
        source=f"{RMF}/rmf_ros2/issues/16",
        site=TWO_ROOMS,
        robots=3,
        orders=(
            visit("there", "5,8", needs="car_1", stand_s=1),
            visit("back", "4,8", needs="car_2", stand_s=1),
            delivery("a", after="there;back"),
        ),
        happens=(
            dies(car="car_1", at=(5, 8), phases=("idle",)),
            dies(car="car_2", at=(4, 8), phases=("idle", "to_pick")),
        ),
        not_done={"a": "drop_1|car_1|car_2"},
        longest_s=90,
        fails_today=everywhere(CUT_OFF),
    ),
    Scenario(
        name="wreck_at_the_exit_of_a_dock",
        what="A car breaks down right behind a dock in which another one is loaded.",
        source=f"{OSRF}/rmf_demos/issues/160",
        site=BACK_TO_BACK,
        robots=2,
        orders=(
            visit("halt", "4,1", needs="car_1", stand_s=10),
            delivery("a", needs="car_0", release_s=6),
        ),
        happens=(Happening(kind="car_dead", target="car_1", when=When(car="car_0", phases=("loading",))),),
        not_done={"halt": "car_1|4,1"},
        longest_s=120,
        fails_today=everywhere(
            "the car in the dock does not back out, and the visit that only the dead car may do stays open"
        ),
    ),
    Scenario(
        name="wreck_at_the_entrance_of_a_dock",
        what="A car breaks down right before a dock, with others behind it in the queue.",
        source="https://github.com/openTCS/opentcs/issues/275",
        site="cell",
        robots=3,
        orders=(visit("halt", "2,1", needs="car_2", stand_s=3), *deliveries(3)),
        happens=(dies(car="car_2", at=(2, 1)),),
        not_done={"halt": "car_2|2,1"},
        longest_s=180,
        fails_today=everywhere(ONE_WAY),
    ),
    Scenario(
        name="dead_with_a_parcel",
        what="A car breaks down in the middle of the floor with a parcel in its tray.",
        source="https://github.com/ros-wg-delib/examples/pull/82",
        site="cell",
        robots=2,
        orders=deliveries(3),
        happens=(dies(phases=("to_drop",), at=(4, 5)),),
        not_done={"a": "parcel stranded: car_0 is dead"},
        longest_s=300,
    ),
    Scenario(
        name="wreck_right_behind_a_dock",
        what="A car breaks down with its parcel behind the dock, where all lanes from the dock lead through.",
        source=f"{RMF}/rmf_ros2/issues/16",
        site="cell",
        robots=2,
        orders=deliveries(2),
        happens=(dies(phases=("to_drop",), at=(4, 2)),),
        not_done={"a": "parcel stranded: car_. is dead"},
        longest_s=120,
        fails_today=everywhere(ONE_WAY),
    ),
    Scenario(
        name="dead_while_loaded",
        what="A car breaks down in the dock while the arm puts a parcel into its tray; there is another dock.",
        source="https://github.com/cangorur/auto_warehouse_robots/issues/5",
        site=BACK_TO_BACK,
        robots=2,
        orders=(delivery("a", "pick_2", "drop_1"), delivery("b", "pick_1", "drop_2", release_s=10)),
        happens=(dies(phases=("loading",), lasts_s=1.0),),
        not_done={"a": "parcel stranded: car_. is dead"},
        longest_s=300,
    ),
    Scenario(
        name="dead_while_unloaded",
        what="A car breaks down in the drop dock while the arm takes its parcel; other orders have another dock.",
        source="https://github.com/openTCS/opentcs-commadapter-vda5050/issues/16",
        site=BACK_TO_BACK,
        robots=2,
        orders=(delivery("a", "pick_2", "drop_2"), delivery("b", "pick_1", "drop_1", after="a")),
        happens=(dies(phases=("unloading",), lasts_s=1.0),),
        longest_s=300,
    ),
    Scenario(
        name="all_dead",
        what="All cars break down.",
        source=f"{RMF}/rmf_ros2/issues/105",
        site="cell",
        robots=2,
        orders=deliveries(2),
        happens=(dies(car="car_0", after_s=2.0), dies(car="car_1", after_s=3.0)),
        not_done={"a": "car", "b": "car"},
        longest_s=90,
        fails_today=everywhere(NO_CAR),
    ),
    Scenario(
        name="its_own_car_is_dead",
        what="An order asks for a car that breaks down before it can begin.",
        source=f"{RMF}/rmf_ros2/pull/233",
        site="cell",
        robots=2,
        orders=(delivery("a", needs="car_0"), delivery("b", needs="car_1", after="a")),
        happens=(dies(car="car_1", after_s=2.0),),
        not_done={"b": "car_1"},
        longest_s=90,
        fails_today=everywhere(ONLY_ITS_CAR),
    ),
    Scenario(
        name="dead_in_its_parking_place",
        what="An idle car breaks down where it is in nobody's way.",
        source=f"{RMF}/rmf_ros2/issues/105",
        site="cell",
        robots=3,
        orders=deliveries(3),
        happens=(dies(car="car_2", after_s=0.0),),
        longest_s=250,
    ),
    Scenario(
        name="car_of_an_assigned_order_dies",
        what="A car breaks down on the way to its pick station: another one fetches the parcel.",
        source="https://arxiv.org/html/2508.03777v1",
        site="cell",
        robots=3,
        orders=deliveries(3),
        happens=(dies(phases=("to_pick",), moves=True, lasts_s=1.0),),
        longest_s=300,
    ),
    Scenario(
        name="leg_changes_hands",
        what="The car of an order with two legs breaks down with the first parcel; the second leg waits for the first.",
        source=f"{RMF}/rmf_ros2/issues/119",
        site="cell",
        robots=2,
        orders=(
            {
                "id": "tour",
                "release_s": 0,
                "type": "multi_stop",
                "stops": "pick_1>drop_1;pick_1>drop_1",
                "mass_kg": 0.3,
                "size_m": 0.06,
            },
            delivery("a"),
        ),
        happens=(dies(phases=("to_drop",), at=(4, 5)),),
        not_done={"tour_1": "parcel stranded", "tour_2": "tour_1"},
        longest_s=300,
    ),
    Scenario(
        name="patrol_changes_hands",
        what="A car breaks down in the middle of a patrol: another one goes on at the place that comes next.",
        source="https://github.com/equinor/flotilla/issues/716",
        site="cell",
        robots=2,
        orders=(visit("a", "6,5", "6,8", "parking_3", kind="patrol", stand_s=1),),
        happens=(dies(phases=("to_place",), moves=True, at=(6, 6)),),
        longest_s=200,
    ),
)

PUSHES_AND_BLOCKS = (
    Scenario(
        name="pushed_before_a_halted_car",
        what="A car is pushed out of its dock to the wall, past which another one has been granted its way.",
        source=f"{RMF}/fleet_adapter_template/issues/7",
        site="cell",
        robots=3,
        orders=deliveries(3),
        happens=(pushed(-0.38, -0.42, phases=("loading",)),),
        not_done={"a": "parcel lies at"},
        longest_s=80,
        fails_today=off_the_grid(
            "the pushed car finds no way back past cells of the halted one, and neither gives way"
        ),
    ),
    Scenario(
        name="pushed_ahead_in_its_dock",
        what="A car is pushed straight ahead when the arm is about to load it, so that its parcel falls to the floor.",
        source=f"{RMF}/rmf/issues/243",
        site="cell",
        robots=3,
        orders=deliveries(4),
        happens=(pushed(0.0, -0.55, phases=("loading",), lasts_s=0.5, after_s=10.0),),
        not_done={"b": "parcel lies at"},
        longest_s=120,
        fails_today=but_with_physics(
            "the pushed car counts as standing at its stop, and is loaded where the arm does not reach"
        ),
    ),
    Scenario(
        name="pushed_off_its_lane",
        what="A car is pushed half out of its lane and has to find back.",
        source=f"{RMF}/free_fleet/issues/136",
        site="cell",
        robots=2,
        orders=deliveries(3),
        happens=(pushed(0.0, 0.3, 0.3, at=(4, 5), moves=True),),
        longest_s=300,
    ),
    Scenario(
        name="blocked_lane_opens_again",
        what="A box lies in the only lane for 40 seconds.",
        source=f"{RMF}/rmf_ros2/pull/15",
        site=RING,
        robots=2,
        orders=deliveries(2),
        happens=(blocked("1,7", 40.0, after_s=3.0),),
        longest_s=250,
    ),
    Scenario(
        name="blocked_lane_with_a_way_round",
        what="A box falls into a lane for good, right before a car; there is a way round.",
        source=f"{RMF}/rmf_ros2/issues/248",
        site="cell",
        robots=2,
        orders=deliveries(3),
        happens=(blocked("4,6", at=(4, 4), moves=True),),
        longest_s=300,
    ),
    Scenario(
        name="blocked_at_the_exit_of_a_dock",
        what="A box falls behind a dock in which a car is loaded, for 40 seconds.",
        source=f"{RMF}/rmf_ros2/issues/493",
        site="cell",
        robots=3,
        orders=deliveries(3),
        happens=(blocked("4,1", 40.0, phases=("loading",), lasts_s=1.0),),
        longest_s=300,
    ),
    Scenario(
        name="one_lane_blocked_for_good",
        what="A box lies in a loop of one lane for good: the other way round everything can be reached.",
        source=f"{RMF}/rmf_ros2/issues/9",
        site=RING,
        robots=2,
        orders=deliveries(1),
        happens=(blocked("1,7", after_s=0.0),),
        longest_s=120,
        fails_today=everywhere(ONE_WAY),
    ),
    Scenario(
        name="floor_cut_for_good",
        what="Boxes lie in both ways from the pick to the drop station for good.",
        source=f"{RMF}/rmf_ros2/issues/16",
        site=RING,
        robots=2,
        orders=deliveries(2),
        happens=(blocked("1,7", after_s=0.0), blocked("3,5", after_s=0.0)),
        not_done={"a": "pick_1|drop_1", "b": "pick_1|drop_1"},
        longest_s=90,
        fails_today=everywhere(CUT_OFF),
    ),
    Scenario(
        name="goal_is_blocked",
        what="A box lies for good in the cell that a car is sent to.",
        source=f"{OSRF}/rmf_core/issues/314",
        site="cell",
        robots=2,
        orders=(visit("a", "6,5"), delivery("b")),
        happens=(blocked("6,5", after_s=0.0),),
        not_done={"a": "6,5"},
        longest_s=90,
        fails_today=everywhere(CUT_OFF),
    ),
)

STATIONS = (
    Scenario(
        name="arm_and_car_wait_for_each_other",
        what="Of two arms over one dock, one is twenty times slower: car and arms have to find together.",
        source=f"{OSRF}/rmf_demos/pull/175",
        site="twin",
        robots=3,
        orders=tuple(delivery(f"o{k}", f"pick_{1 + k % 2}", f"drop_{1 + k // 2 % 2}") for k in range(4)),
        happens=(
            Happening(
                kind="arm_slow", target="arm_0", parameters={"factor": 0.05, "duration_s": 60.0}, when=When(after_s=1.0)
            ),
        ),
        longest_s=400,
    ),
    Scenario(
        name="slow_arm_with_a_full_queue",
        what="The only pick arm works at a tenth of its speed for a minute, with all cars in its queue.",
        source=f"{OSRF}/rmf_demos/issues/160",
        site="cell",
        robots=3,
        orders=deliveries(4),
        happens=(
            Happening(
                kind="arm_slow", target="arm_0", parameters={"factor": 0.1, "duration_s": 60.0}, when=When(after_s=1.0)
            ),
        ),
        longest_s=400,
    ),
    Scenario(
        name="full_drop_rack",
        what="The drop rack has one slot, and a parcel stays on it for 30 seconds.",
        source="http://deepblue.lib.umich.edu/bitstream/handle/2027.42/8322/bam4177.0001.001.txt?sequence=4&isAllowed=y",
        site="cell",
        robots=3,
        orders=deliveries(4),
        settings={"collect_after_s": 30.0},
        stations={"drop_1": ONE_SLOT},
        longest_s=400,
    ),
    Scenario(
        name="one_slot_for_all",
        what="Pick and drop rack have one slot each.",
        source="https://paperexplained.cn/articles/paper/detail/4591336df0a88836d47acda9cd6a2271a10ff413",
        site="cell",
        robots=3,
        orders=deliveries(4),
        stations={"pick_1": ONE_SLOT, "drop_1": ONE_SLOT},
        longest_s=400,
    ),
    Scenario(
        name="rack_full_of_what_cannot_be_delivered",
        what="Parcels for a dock that a wreck stands in fill the pick rack; those for another dock wait behind them.",
        source="https://paperexplained.cn/articles/paper/detail/bafa53640c04d2ee2a26789fa27b33af898b4c28",
        site=BACK_TO_BACK,
        robots=3,
        orders=(
            visit("halt", "drop_1", needs="car_2", stand_s=1),
            *deliveries(5, drop="drop_1", after="halt"),
            *deliveries(3, first="p", drop="drop_2", after="halt"),
        ),
        happens=(dies(car="car_2", at=(3, 10), phases=("idle",)),),
        not_done=dict.fromkeys("abcde", "drop_1|car_2"),
        longest_s=180,
        fails_today=everywhere(
            "parcels that cannot be delivered keep their slots, and those behind them wait until the run stalls"
        ),
    ),
    Scenario(
        name="grip_lost",
        what="The grip of the pick arm fails while it carries a parcel.",
        source="https://github.com/usnistgov/ARIAC/issues/413",
        site="cell",
        robots=2,
        orders=deliveries(2),
        happens=(Happening(kind="grip_lost", target="arm_0", parameters={"carried_s": 0.5}, when=When(after_s=1.0)),),
        longest_s=300,
        tries_physics=True,
    ),
    Scenario(
        name="grip_lost_at_the_last_moment",
        what="The grip of the drop arm fails when the parcel is almost on its slot.",
        source="https://github.com/usnistgov/ARIAC/issues/109",
        site="cell",
        robots=2,
        orders=deliveries(2),
        happens=(Happening(kind="grip_lost", target="arm_1", parameters={"carried_s": 2.5}, when=When(after_s=1.0)),),
        longest_s=300,
    ),
)

ORDERS_AND_BATTERIES = (
    Scenario(
        name="two_orders_wait_for_each_other",
        what="Two orders each are to begin after the other, and a third after one of them.",
        source="https://github.com/sipyourdrink-ltd/bernstein/issues/4287",
        site="cell",
        robots=1,
        orders=(delivery("a", after="b"), delivery("b", after="a"), delivery("c", after="a"), delivery("d")),
        not_done={"a": "a circle of a, b", "b": "a circle of a, b", "c": "'a' was refused"},
        longest_s=150,
    ),
    Scenario(
        name="no_order_can_be_right",
        what="All orders wait for each other.",
        source="https://github.com/CCExtractor/ccsync/issues/308",
        site="cell",
        robots=1,
        orders=(delivery("a", after="b"), delivery("b", after="a")),
        refused=r"OrdersError: .*a circle of a, b",
        longest_s=10,
    ),
    Scenario(
        name="order_after_one_that_fails",
        what="An order is to begin after one whose parcel is lost in a wreck.",
        source=f"{RMF}/rmf_demos/issues/330",
        site="cell",
        robots=2,
        orders=(delivery("a"), delivery("b", after="a"), delivery("c")),
        happens=(dies(phases=("to_drop",), at=(4, 5)),),
        not_done={"a": "parcel stranded", "b": "^a, which comes before it"},
        longest_s=300,
    ),
    Scenario(
        name="charger_queue",
        what="Three cars with low batteries and one charger.",
        source=f"{RMF}/rmf_ros2/pull/423",
        site="cell",
        robots=3,
        orders=deliveries(3),
        settings={"battery": BatteryConfig(enabled=True, start=0.28, **SMALL_BATTERY)},
        longest_s=500,
    ),
    Scenario(
        name="two_charge_orders",
        what="Two cars are sent to the same charger at the same time.",
        source=f"{RMF}/rmf_ros2/issues/149",
        site="cell",
        robots=2,
        orders=(visit("a", kind="charge", needs="car_0"), visit("b", kind="charge", needs="car_1"), delivery("c")),
        settings={"battery": BatteryConfig(enabled=True, start=0.5, **SMALL_BATTERY)},
        longest_s=400,
    ),
    Scenario(
        name="low_with_a_parcel",
        what="Batteries become critical while parcels are in the trays.",
        source="https://github.com/equinor/flotilla/issues/1758",
        site="cell",
        robots=2,
        orders=deliveries(2),
        settings={"battery": BatteryConfig(enabled=True, start=0.34, capacity_wh=1.0, idle_below=0.3)},
        longest_s=400,
    ),
    Scenario(
        name="wreck_in_the_only_charger",
        what="A car breaks down in the only charger while the other one still has enough for the orders.",
        source=f"{OSRF}/rmf_core/pull/245",
        site="cell",
        robots=2,
        orders=(visit("charge", kind="charge", needs="car_1"), *deliveries(2)),
        happens=(dies(car="car_1", phases=("charging",), lasts_s=2.0),),
        settings={"battery": BatteryConfig(enabled=True, start=0.7, **SMALL_BATTERY)},
        not_done={"charge": "car_1"},
        longest_s=120,
        fails_today=everywhere(ONLY_ITS_CAR),
    ),
    Scenario(
        name="battery_empty_on_the_way_to_the_charger",
        what="Both cars have too little charge to come to the charger.",
        source=f"{OSRF}/rmf_core/pull/222",
        site="cell",
        robots=2,
        orders=deliveries(2),
        settings={"battery": BatteryConfig(enabled=True, start=0.02, capacity_wh=0.5)},
        not_done={"a": "car", "b": "car"},
        longest_s=90,
        fails_today=everywhere(NO_CAR),
    ),
)

SCENARIOS = (*TRAFFIC, *WRECKS, *PUSHES_AND_BLOCKS, *STATIONS, *ORDERS_AND_BATTERIES)
