"""The paper's virtual prototype: its arm, motions and sensors, and how torques and answers are taken from its logs."""
