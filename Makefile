# The commands of this repository; `make help` lists them. CI runs `make test` and nothing else.
.DEFAULT_GOAL := help
.PHONY: help demo test python robots fleet parity bench speed dashboard screenshots

help: ## Show this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1|/p' Makefile | awk -F'|' '{ printf "%-28s %s\n", $$1, $$2 }'

demo: ## Learn a rendered year, localise the next one, write target/demo/report.html
	@bash scripts/demo.sh

test: ## Everything CI runs; CHRONOTOPE_DATA=DIR adds the tests on real data
	@bash scripts/test.sh

python: ## Build and test the Python package in a throw-away environment (a part of `make test`)
	@bash scripts/python.sh

robots: ## Build and test bags in and out, the ROS 2 node and the C interface (a part of `make test`)
	@bash scripts/robots.sh

fleet: ## Learn 50 million observations on a Spark cluster of two processes, and in one; compare, print the table
	@bash scripts/fleet.sh

parity: ## With DATA=DIR: our STAR and BRIEF against OpenCV's on every image of a folder
	@test -n "$(DATA)" || { echo 'name the folder of images: make parity DATA=DIR' >&2; exit 2; }
	@sh scripts/parity.sh "$(DATA)"

bench: ## Benchmarks of feature extraction and matching
	cargo bench -p chronotope

speed: ## One table against OpenCV, hnsw_rs and FAISS; DATA=DIR: on real images, RECORD=DIR: kept there, too
	@sh scripts/speed.sh $(if $(DATA),--data "$(DATA)") $(if $(RECORD),--record "$(RECORD)")

dashboard: ## Record the demo for the rerun viewer: target/dashboard/synthetic.rrd
	@bash scripts/dashboard.sh

screenshots: ## Pictures of recordings in docs/, without a screen; with DATA=DIR also of real images
	@bash scripts/screenshots.sh $(if $(DATA),"$(DATA)")
