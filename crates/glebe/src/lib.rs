//! glebe: a Discrete Element Method engine.

