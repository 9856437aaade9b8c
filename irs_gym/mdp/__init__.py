"""The rules of the task: what a robot may do, what it sees and what it is paid."""
