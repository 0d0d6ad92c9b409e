"""Uses an exported policy from Python: python3 use_policy.py FOLDER

FOLDER is what `gigastep export RUN --team 0 --format safetensors --out FOLDER` wrote. Needs numpy and safetensors.
Describes a situation by the names in the manifest, and prints the most likely action and the first logits.
"""

import importlib.util
import pathlib
import sys

import numpy as np


def load(folder):
    """act.py of an export, as a module: its class Policy, its function act, its manifest."""
    spec = importlib.util.spec_from_file_location("act", pathlib.Path(folder) / "act.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def set_number(obs, manifest, block, feature, value, item=0):
    """Sets a feature of one item of a block, for example the nearness of the third wall. Blocks that are not there are
    passed over, so that a program fits policies with and without the egocentric view."""
    for b in manifest["observation"]["blocks"]:
        for f in b["features"]:
            if (b["name"], f["name"]) == (block, feature):
                start, _, step = f["slice"]
                obs[0, start + item * step] = value


def main(folder):
    export = load(folder)
    policy, manifest = export.Policy(), export.MANIFEST

    # The agent is in the middle of the map and flies along x; one opponent is ahead of it, to its left.
    obs = export.example_observation()
    # Of x and y 0.08 and 0.06 are 0.8 and 0.6 units on a map of 10 x 10. A policy that reads the egocentric view
    # computes it from this; only one that was exported with --view input is told.
    opponent = {"seen": 1, "x": 0.08, "y": 0.06, "heading": np.pi, "health": 1, "sprite": 1}
    for feature, value in opponent.items():
        set_number(obs, manifest, "neighbors", feature, value)
    for feature, value in {"nearness": 0.5, "ahead": 0.8, "left": 0.6, "course_ahead": -1, "health": 1}.items():
        set_number(obs, manifest, "egocentric_opponents", feature, value)

    # The first step of an episode. A policy with memory gets at the next step what it gives out here.
    heads, state = policy.step(obs, export.start(len(obs)))
    head = heads[0]
    action = export.act(head)
    print("action:", manifest["action"]["table"][action] if manifest["action"]["kind"] == "discrete" else action)
    print("head:", " ".join(f"{number:.4f}" for number in head[:3]))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: use_policy.py FOLDER")
    main(sys.argv[1])
