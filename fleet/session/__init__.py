"""Session: one run with its files, its recording and its progress."""

from fleet.session.runner import Result as Result
from fleet.session.runner import SessionConfig as SessionConfig
from fleet.session.runner import run_session as run_session
