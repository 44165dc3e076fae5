"""The public interface: one function for each job, with results in SI units. Commands are thin callers of it."""
