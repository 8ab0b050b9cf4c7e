"""Where a fit may begin: what ranges, inputs, encoders and the residual torque suggest."""
