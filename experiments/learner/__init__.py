"""The learner of swap tests on the true reward, and beside Brax's PPO."""
