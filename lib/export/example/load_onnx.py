"""Loads the policy beside this file and acts on one observation: python3 act.py

Needs numpy and onnxruntime.
"""

import json
import pathlib

import numpy as np
import onnxruntime

FOLDER = pathlib.Path(__file__).resolve().parent
MANIFEST = json.loads((FOLDER / "manifest.json").read_text(encoding="utf-8"))


class Policy:
    """Observations [B, size] float32 -> logits [B, 27] or means [B, 3], and what is remembered until the next step."""

    def __init__(self):
        self.session = onnxruntime.InferenceSession(FOLDER / MANIFEST["file"], providers=["CPUExecutionProvider"])

    def step(self, obs, state):
        if MANIFEST["state"]["size"] == 0:
            (head,) = self.session.run([MANIFEST["action"]["output"]], {MANIFEST["observation"]["input"]: obs})
            return head, state
        outputs = [MANIFEST["action"]["output"], MANIFEST["state"]["output"]]
        inputs = {MANIFEST["observation"]["input"]: obs, MANIFEST["state"]["input"]: state}
        return self.session.run(outputs, inputs)
