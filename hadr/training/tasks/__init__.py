"""What each network is trained to do: its samples, its loss, its score."""
