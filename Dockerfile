# CPU image: the wheel of this checkout, installed and tried. `make docker` builds it;
#   docker run --rm -v "$PWD/runs:/wt/runs" world-translation fit --config conf/r5.yaml
FROM python:3.11-slim

# pip takes torch's CPU build where it finds one; PyPI's own brings CUDA.
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
ENV PIP_NO_CACHE_DIR=1

WORKDIR /src
COPY . .
RUN PIP_EXTRA_INDEX_URL=$TORCH_INDEX tests/wheel_smoke.sh install /env
RUN tests/wheel_smoke.sh run /env /tmp/smoke && rm -rf /tmp/smoke

WORKDIR /wt
RUN cp -r /src/conf conf
ENTRYPOINT ["/env/bin/wt"]
CMD ["--help"]
