# From what the policy gives for an observation to an action, and a try of it.


def start(n):
    """What n agents remember at the first step of an episode: nothing. [n, 0] where the policy has no memory."""
    return np.zeros((n, MANIFEST["state"]["size"]), np.float32)


def act(head, random=None):
    """The action for one row of a policy's output: drawn with a numpy.random.Generator, the most likely one without.

    A policy whose "action_selection" is "greedy" learned to take its most likely action, and always does.
    Discrete: an index into the manifest's table. Continuous: heading, dive and throttle in (-1, 1).
    """
    if MANIFEST["action_selection"] == "greedy":
        random = None
    if MANIFEST["action"]["kind"] == "discrete":
        if random is None:
            return int(np.argmax(head))
        return int(np.argmax(head + random.gumbel(size=head.shape)))  # is a draw from softmax(head)
    if random is not None:
        head = head + np.exp(MANIFEST["action"]["log_std"]) * random.standard_normal(head.shape)
    return np.tanh(head)


def example_observation():
    """An agent in the middle of the map that flies along x, alone as far as it sees; the rest zeros. Or a black image."""
    if MANIFEST["observation"]["type"] == "uint8":
        return np.zeros((1, *MANIFEST["observation"]["shape"]), np.uint8)
    obs = np.zeros((1, MANIFEST["observation"]["size"]), np.float32)
    (me,) = (block for block in MANIFEST["observation"]["blocks"] if block["name"] == "self")
    values = {"seen": 1, "same_team": 1, "x": 0.5, "y": 0.5, "z": 0.5, "speed": 0.15, "health": 1, "sprite": 1}
    for feature in me["features"]:
        obs[0, slice(*feature["slice"])] = values.get(feature["name"], 0)
    return obs


if __name__ == "__main__":
    policy, random = Policy(), np.random.default_rng(0)  # draws the same each time
    state = start(1)  # at the first step of each episode
    for _ in range(3):  # three steps of one agent
        obs = example_observation()  # what it sees now
        head, state = policy.step(obs, state)
        action = act(head[0], random)
        print(MANIFEST["action"]["table"][action] if MANIFEST["action"]["kind"] == "discrete" else action)
