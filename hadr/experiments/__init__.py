"""The paper's tables measured again: which systems, on which frames, and what came out."""
