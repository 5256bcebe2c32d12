"""Two feature maps of one size become one: window by window, each asks the other.

Source: Dai et al. 2022, "Domain Randomization-Enhanced Depth Simulation and Restoration for
Perceiving and Grasping Specular and Transparent Objects"; the windows and the score of a place
are those of Liu et al. 2021, "Swin Transformer".
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

UNMIXED = -1e4
"""Score of a key that must not be attended to: no weight after a softmax, in 16 bits too."""


class WindowCrossAttention(nn.Module):
    """Tokens of one map ask those of another in the same window.

    Windows do not overlap and are not shifted. A map that a window (its side in tokens) does not
    divide is padded to the right and below; nobody attends to the padding.
    """

    def __init__(self, channels: int, heads: int, window: int) -> None:
        super().__init__()
        self.heads, self.window = heads, window
        self.ask = nn.Linear(channels, channels)
        self.tell = nn.Linear(channels, 2 * channels)
        self.answer = nn.Linear(channels, channels)
        self.offset = nn.Parameter(torch.zeros((2 * window - 1) ** 2, heads))
        nn.init.trunc_normal_(self.offset, std=0.02)

    def forward(self, asking: Tensor, asked: Tensor) -> Tensor:
        """Say what each token of a map (B, H, W, C) is told by another map (B, H, W, C)."""
        _, height, width, channels = asking.shape
        side = (min(self.window, height), min(self.window, width))
        query = self._windows(self.ask(asking), side)  # (B, windows, heads, tokens, C / heads)
        key, value = (self._windows(v, side) for v in self.tell(asked).chunk(2, dim=-1))
        scale: float = (channels // self.heads) ** -0.5
        scores = scale * query @ key.transpose(-2, -1) + self._place(side)
        there = torch.ones(1, height, width, self.heads, dtype=torch.bool, device=asking.device)
        there = self._windows(there, side)[..., 0].unsqueeze(-2)  # (1, windows, heads, 1, tokens)
        weights = scores.masked_fill(~there, UNMIXED).softmax(dim=-1)
        told = weights.to(value.dtype) @ value  # (B, windows, heads, tokens, C / heads)
        (tall, wide), frames = side, len(told)
        down, across = -(-height // tall), -(-width // wide)
        parts = told.reshape(frames, down, across, self.heads, tall, wide, -1)
        whole = parts.permute(0, 1, 4, 2, 5, 3, 6).reshape(frames, down * tall, across * wide, -1)
        answer: Tensor = self.answer(whole[:, :height, :width])  # without the padding
        return answer

    def _windows(self, tokens: Tensor, side: tuple[int, int]) -> Tensor:
        """Cut (B, H, W, C) into (B, windows, heads, tokens of a window, C / heads)."""
        frames, height, width, _ = tokens.shape
        (tall, wide), heads = side, self.heads
        padded = functional.pad(tokens, (0, 0, 0, -width % wide, 0, -height % tall))
        down, across = padded.shape[1] // tall, padded.shape[2] // wide
        parts = padded.reshape(frames, down, tall, across, wide, heads, -1)
        return parts.permute(0, 1, 3, 5, 2, 4, 6).reshape(
            frames, down * across, heads, tall * wide, -1
        )

    def _place(self, side: tuple[int, int]) -> Tensor:
        """Score of a key for its place relative to the query: (heads, tokens, tokens)."""
        device, reach = self.offset.device, self.window - 1
        row = torch.arange(side[0], device=device).repeat_interleave(side[1])  # (tokens,)
        column = torch.arange(side[1], device=device).repeat(side[0])  # (tokens,)
        down = row[:, None] - row[None, :] + reach  # (tokens, tokens), 0..2 reach
        across = column[:, None] - column[None, :] + reach
        return self.offset[down * (2 * self.window - 1) + across].permute(2, 0, 1)


class CrossFusion(nn.Module):
    """Fuse the colour and the depth map of a stage: each asks the other, then both are joined."""

    def __init__(self, channels: int, heads: int, window: int) -> None:
        super().__init__()
        both = range(2)
        self.before = nn.ModuleList(nn.LayerNorm(channels) for _ in both)
        self.attend = nn.ModuleList(WindowCrossAttention(channels, heads, window) for _ in both)
        self.between = nn.ModuleList(nn.LayerNorm(channels) for _ in both)
        self.think = nn.ModuleList(
            nn.Sequential(
                nn.Linear(channels, 4 * channels), nn.GELU(), nn.Linear(4 * channels, channels)
            )
            for _ in both
        )
        self.join = nn.Linear(2 * channels, channels)
        self.after = nn.LayerNorm(channels)
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.trunc_normal_(module.weight, std=0.02)
                nn.init.zeros_(module.bias)

    def forward(self, color: Tensor, depth: Tensor) -> Tensor:
        """Fuse colour and depth features, (B, C, H, W) each, to the same shape."""
        streams = [color.permute(0, 2, 3, 1), depth.permute(0, 2, 3, 1)]  # each (B, H, W, C)
        normal = [norm(stream) for norm, stream in zip(self.before, streams, strict=True)]
        for number in range(2):
            told = self.attend[number](normal[number], normal[1 - number])
            stream = streams[number] + told
            streams[number] = stream + self.think[number](self.between[number](stream))
        fused: Tensor = self.after(self.join(torch.cat(streams, dim=-1)))  # (B, H, W, C)
        return fused.permute(0, 3, 1, 2)
