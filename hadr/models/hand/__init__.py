"""Networks and inputs that know the hand: keypoints, crop, prior."""
