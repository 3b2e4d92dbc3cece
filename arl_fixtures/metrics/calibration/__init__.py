"""Re-calibration of K and δ from the intrinsic targets: circle centres, camera model, bundle adjustment."""
