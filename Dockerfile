# CPU images of this checkout. `make docker` builds the whole, `make docker-run` the runner alone.
# Runs, collections and MLflow's store stay in the folder that is mounted, and are the user's who is
# named; a user whom the image does not know has no home, hence HOME:
#   docker run --rm -u $(id -u):$(id -g) -v "$PWD:/wt" world-translation fit --config r5
#   docker run --rm -it --network host -u $(id -u):$(id -g) -v "$PWD:/wt" world-translation-run \
#       --policy go2
FROM python:3.11-slim AS run
ENV PIP_NO_CACHE_DIR=1
WORKDIR /src
COPY . .
RUN python -m venv /env && /env/bin/pip install -c constraints.txt '.[deploy]'
ENV HOME=/tmp
WORKDIR /wt
VOLUME /wt
ENTRYPOINT ["/env/bin/wt-run"]
CMD ["--help"]

FROM python:3.11-slim AS whole
# pip takes torch's CPU build where it finds one; PyPI's own brings CUDA.
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
ENV PIP_NO_CACHE_DIR=1
WORKDIR /src
COPY . .
RUN PIP_EXTRA_INDEX_URL=$TORCH_INDEX tests/wheel_smoke.sh install /env fit
RUN tests/wheel_smoke.sh fit /env /tmp/smoke && rm -rf /tmp/smoke
ENV HOME=/tmp
WORKDIR /wt
VOLUME /wt
ENTRYPOINT ["/env/bin/wt"]
CMD ["--help"]
