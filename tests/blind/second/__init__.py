"""The second generator of hidden effects: two masses at every joint, servos of several structures, noise of real rigs.

Written from the vocabulary of effects alone. It shares code neither with the finder nor with the first generator.
"""
