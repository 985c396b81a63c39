#!/usr/bin/env python3
"""Prints the tables of PAGING.md from a runs.csv that stoop-compare wrote for tools/policy-grid.json.

Usage: tools/paging-tables.py RUNS.csv
"""
import csv
import sys

POLICIES = ["demand", "front", "range", "vgis", "foresight", "oracle"]
PUBLISHED = POLICIES[:4]
# Debts this near to one another are the same.
SAME_SHARE, SAME_PX_S = 0.01, 0.01
# The aim: debt within AIM_FACTOR times the larger of oracle and bound, and AIM_PX for each second after the start.
AIM_FACTOR, AIM_PX, COLD_S = 1.5, 0.02, 2.0


def debt(run):
    return float(run["debt_px_s"])


def best_of_each(runs):
    best = {}
    for run in runs:
        label = run["policy"]
        if label not in best or debt(run) < debt(best[label]):
            best[label] = run
    return best


def shown(value):
    value = float(value)
    return "0" if value < 5e-4 else f"{value:.3f}" if value < 10 else f"{value:,.0f}"


def table(head, rows):
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print()


def main(path):
    with open(path, newline="") as file:
        runs = list(csv.DictReader(file))
    by_row = {}
    for run in runs:
        by_row.setdefault((run["flight"], run["storage"]), []).append(run)
    rows = {key: best_of_each(runs) for key, runs in by_row.items()}
    terms = [label for label in next(iter(rows.values())) if label.startswith("foresight,")]

    debts, details, losses, won, aimed = [], [], [], [], []
    for (flight, storage), best in rows.items():
        ours, bound = best["foresight"], float(best["foresight"]["bound_px_s"])
        # Runs have as many frames as steps of 1/30 s fit into the flight.
        seconds = int(ours["frames"]) / 30 - COLD_S
        is_best = all(debt(ours) <= debt(best[other]) * (1 + SAME_SHARE) + SAME_PX_S for other in PUBLISHED)
        in_aim = debt(ours) <= AIM_FACTOR * max(debt(best["oracle"]), bound) + AIM_PX * seconds
        won.append(is_best)
        aimed.append(in_aim)
        cold = [shown(best[policy]["cold_debt_px_s"]) for policy in ("demand", "foresight", "oracle")]
        ratio = debt(ours) / max(debt(best["oracle"]), bound, 5e-4)
        debts.append([flight, storage, shown(bound), *(shown(debt(best[policy])) for policy in POLICIES),
                      f"{ratio:.2f}" if debt(ours) >= 5e-4 else "–", "yes" if is_best else "**no**",
                      "yes" if in_aim else "**no**", *cold, shown(ours["cold_bound_px_s"])])
        for policy in POLICIES:
            run = best[policy]
            waste = 100 * float(run["wasted_bytes"]) / max(1.0, float(run["bytes"]))
            details.append([flight, storage, policy, shown(debt(run)), f"{waste:.0f} %", f"{float(run['bytes']) / 1e6:.1f}",
                            run["requests"], run["seeks"], f"{float(run['time_to_sharp_ms']):.0f}", run["variant"] or "–"])
        if max(debt(best[label]) for label in [*terms, "foresight"]) >= 0.05:
            losses.append([flight, storage, shown(debt(ours)), *(shown(debt(best[term])) for term in terms)])

    print(f"`foresight` is best on {sum(won)} of {len(won)} rows, and within the aim on {sum(aimed)}.\n")
    table(["flight", "storage", "bound", *POLICIES, "foresight ÷ max(oracle, bound)", "best", "aim", "cold: demand",
           "foresight", "oracle", "bound"], debts)
    print("## Losses\n")
    table(["flight", "storage", "whole", *(term.split(", ", 1)[1] for term in terms)], losses)
    print("## Details\n")
    table(["flight", "storage", "policy", "px·s", "waste", "MB", "requests", "seeks", "ms to sharp", "parameters"], details)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__.strip())
    main(sys.argv[1])
