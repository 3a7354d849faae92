"""What stands around the robot, over REST: said, read back, refused."""

WALL = {"name": "wall", "center_mm": [0, -1200, 0], "size_mm": [3000, 100, 2500]}


def surroundings(at):
    return at("GET", "/results/setup").json()["setup"]["surroundings"]


def test_obstacles_are_added_changed_and_taken_away(at):
    assert at("POST", "/commands/AddObstacle", json=WALL).status_code == 200
    assert [box["name"] for box in surroundings(at)["boxes"]] == ["wall"]
    changed = {**WALL, "turn_deg": 30.0}
    assert at("POST", "/commands/AddObstacle", json=changed).status_code == 200
    assert [box["turn_deg"] for box in surroundings(at)["boxes"]] == [30.0]
    body = {"table": False, "margin_mm": 40}
    assert at("POST", "/commands/SetWorkcell", json=body).status_code == 200
    held = surroundings(at)
    assert (held["table"], held["margin_mm"], len(held["boxes"])) == (False, 40.0, 1)
    assert at("POST", "/commands/RemoveObstacle", json={"name": "wall"}).status_code == 200
    assert surroundings(at)["boxes"] == []


def test_what_is_no_obstacle_is_refused_and_changes_nothing(at):
    before = surroundings(at)
    for body, status, words in (
        ({**WALL, "name": "floor"}, 422, "there already"),
        ({**WALL, "size_mm": [1, 1]}, 422, "size_mm"),
        ({**WALL, "size_mm": [1, 1, 0]}, 422, "size_mm must be 1 to 5000, not 0"),
        ({**WALL, "colour": "red"}, 422, "colour"),
    ):
        answer = at("POST", "/commands/AddObstacle", json=body)
        assert answer.status_code == status
        assert words in answer.text
    answer = at("POST", "/commands/RemoveObstacle", json={"name": "door"})
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    assert surroundings(at) == before
