"""Runs whose cars obey a foreign master by VDA 5050: messages become goals and services, and what happens is told.

Only this folder imports MQTT; `fleet.vda5050` has the rules of the protocol.
"""

from fleet.gateway.config import GatewayConfig as GatewayConfig
from fleet.gateway.simulation import MasteredSimulation as MasteredSimulation
