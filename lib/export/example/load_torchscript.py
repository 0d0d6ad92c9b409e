"""Loads the policy beside this file and acts on one observation: python3 act.py

Needs numpy and torch. A TorchScript file is code: load only one whose origin you trust.
"""

import json
import pathlib

import numpy as np
import torch

FOLDER = pathlib.Path(__file__).resolve().parent
MANIFEST = json.loads((FOLDER / "manifest.json").read_text(encoding="utf-8"))


class Policy:
    """Observations [B, size] float32 -> logits [B, 27] or means [B, 3], and what is remembered until the next step."""

    def __init__(self):
        self.module = torch.jit.load(FOLDER / MANIFEST["file"], map_location="cpu").eval()

    def step(self, obs, state):
        with torch.inference_mode():
            if MANIFEST["state"]["size"] == 0:
                return self.module(torch.from_numpy(obs)).numpy(), state
            head, state = self.module(torch.from_numpy(obs), torch.from_numpy(state))
            return head.numpy(), state.numpy()
