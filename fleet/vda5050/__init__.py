"""VDA 5050 from the vehicle's side: messages, dialects, the acceptance of orders, and the state machine of a vehicle.

Nothing here reads, writes or waits: a message or something that the vehicle noticed goes in, messages come out. Inside,
everything has the words of version 3.0.0; `dialects` says what the versions call it on the wire. The folder `schemas`
holds the official schemas of 2.1.0 and 3.0.0 with their licence, for tests.

Source: https://github.com/VDA5050/VDA5050, tags 2.0.0 and 2.1.0, and 3.0.0 as of 2 July 2026 (0b2ae43); sections that
are named here are those of VDA5050_EN.md of 3.0.0.
"""
