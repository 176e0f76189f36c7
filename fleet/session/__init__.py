"""Session: one run with its files, its recording and its progress."""

from fleet.session.run import Result as Result
from fleet.session.run import SessionConfig as SessionConfig
from fleet.session.run import run_session as run_session
