"""The hand: shape, skin, mesh, signed distance."""
