"""What the model leaves: residual torque, where and when it lies, its spectra, and whether it is white."""
