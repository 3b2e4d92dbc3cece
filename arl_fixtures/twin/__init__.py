"""The nominal physics of bench and sensor: scene, optics, noise, thermal plant."""
