"""Drawings: the floors that scenarios share."""

LOOP = """
#######
_KKKKK_
AP###DA
_KKKKK_
#######
"""
"""A loop of twelve cells, ten of them parking: every car stands in the way of all others."""

RING = """
##########
_..KKKK.._
AP######DA
_........_
##########
"""
"""One lane, a loop of eighteen cells."""

EIGHT = """
############
_.KKKv######
AP###v######
_.###v######
#.<<<.<<<<.#
#####v####._
#####v####DA
#####.KKK.._
############
"""
"""Two loops that cross in one cell."""

CORRIDOR = """
###############
_.....###....._
AP.K..###..K.DA
_....xxxxx...._
#..K..###..K..#
#.....###.....#
###############
"""
"""Two rooms and a corridor that is driven both ways."""

TWO_ROOMS = """
#################
#......###......#
_......###......_
AP.KK..###..K..DA
_......<<<......_
#......>>>......#
#...K..###......#
#......###......#
#################
"""
"""Two rooms, a corridor to the one and a corridor to the other."""

BACK_TO_BACK = """
############
#..........#
_..KK..KK.._
AP........DA
_.........._
AP........DA
_..==..==.._
#..........#
############
"""
"""The exit of each dock is the entrance of the next."""

DEAD_END = """
############
#..........#
_..KK..KK.._
AP........DA
_.........._
####.xx.####
####xxx#####
#####x######
############
"""
"""A pocket with one cell at its end, which cars can only leave backwards."""

NO_PASSING_PLACE = """
############
#..........#
_..KK..KK.._
AP........DA
_.........._
#.==.==.=x##
#########x##
############
"""
"""A two-way lane in which nobody can step aside."""

DEAD_END_PARKING = """
############
#..........#
_..K...K..._
AP........DA
_.........._
#..==.=.==.#
###..#K#...#
############
"""
"""A parking place with one way in and none out."""
