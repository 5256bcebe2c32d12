"""Data: the on-disk layout of TransHand-14K, splits, augmentation and the bundled samples."""
