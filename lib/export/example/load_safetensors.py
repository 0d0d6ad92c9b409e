"""Loads the policy beside this file and acts on one observation: python3 act.py

Needs numpy and safetensors. Nothing in the file is executed.
"""

import json
import math
import pathlib

import numpy as np
from safetensors.numpy import load_file

FOLDER = pathlib.Path(__file__).resolve().parent
MANIFEST = json.loads((FOLDER / "manifest.json").read_text(encoding="utf-8"))

ACTIVATIONS = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "silu": lambda x: x / (1 + np.exp(-x)),
    "gelu": lambda x: x * 0.5 * (1 + np.vectorize(math.erf)(x * math.sqrt(0.5))),
}


class Policy:
    """Observations [B, size] float32, or images [B, side, side, 3] uint8 -> logits [B, 27] or means [B, 3], and what is remembered until the next step."""

    def __init__(self):
        self.tensors = load_file(FOLDER / MANIFEST["file"])
        self.architecture = MANIFEST["architecture"]

    def normalised(self, x):
        limit = self.architecture["normalized_limit"]
        x = (x - self.tensors["observation.mean"]) / self.tensors["observation.std"]
        return np.clip(x, -limit, limit)

    def layer_norm(self, x, name):
        centred = x - x.mean(-1, keepdims=True)
        variance = (centred**2).mean(-1, keepdims=True)
        x = centred / np.sqrt(variance + self.architecture["layer_norm_epsilon"])
        return x * self.tensors[name + "norm_weight"] + self.tensors[name + "norm_bias"]

    def remember(self, x, state):
        """What comes out of the recurrent cell, and its next state."""
        t, lstm = self.tensors, self.architecture["memory"] == "lstm"
        h, c = np.split(state, 2, axis=1) if lstm else (state, None)
        into = np.split(x @ t["memory.input_weight"].T + t["memory.input_bias"], 4 if lstm else 3, axis=1)
        back = np.split(h @ t["memory.hidden_weight"].T + t["memory.hidden_bias"], 4 if lstm else 3, axis=1)
        gates = [1 / (1 + np.exp(-i - b)) for i, b in zip(into, back)]
        if lstm:  # in, forget, candidate, out
            c = gates[1] * c + gates[0] * np.tanh(into[2] + back[2])
            h = gates[3] * np.tanh(c)
            return h, np.concatenate([h, c], axis=1).astype(np.float32)
        candidate = np.tanh(into[2] + gates[0] * back[2])  # reset, update, candidate
        h = (1 - gates[1]) * candidate + gates[1] * h
        return h, h.astype(np.float32)

    def step(self, obs, state):
        x = network_input(obs, self.tensors)
        x = self.normalised(x) if self.architecture["normalizes_observations"] else x
        n_hidden = len(self.architecture["hidden"])
        for k in range(n_hidden + 1):
            if k == n_hidden and MANIFEST["state"]["size"] > 0:
                x, state = self.remember(x, state)
            name = f"layers.{k}."
            x = x @ self.tensors[name + "weight"].T + self.tensors[name + "bias"]
            if k < n_hidden:
                x = self.layer_norm(x, name) if self.architecture["layer_norm"] else x
                x = ACTIVATIONS[self.architecture["activation"]](x)
        return x.astype(np.float32), state
